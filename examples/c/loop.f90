! loop.f90 - a frozen model in Fortran: prints the first output after some fine steps.
!
!     gfortran loop.f90 -L... -lpmalpha -o loop && ./loop model.pma 1000
program loop
  use, intrinsic :: iso_c_binding
  implicit none
  interface
    integer(c_int) function pmalpha_open(path, message, model) bind(C)
      import
      character(kind=c_char), intent(in) :: path(*)
      character(kind=c_char), intent(out) :: message(256)
      type(c_ptr), intent(out) :: model
    end function
    integer(c_int) function pmalpha_command(model, i, c) bind(C)
      import
      type(c_ptr), value :: model
      integer(c_int), value :: i
      real(c_double), intent(out) :: c(3)
    end function
    integer(c_int) function pmalpha_set(model, i, x) bind(C)
      import
      type(c_ptr), value :: model
      integer(c_int), value :: i
      real(c_double), value :: x
    end function
    integer(c_int) function pmalpha_advance(model, steps) bind(C)
      import
      type(c_ptr), value :: model
      integer(c_size_t), value :: steps
    end function
    real(c_double) function pmalpha_get(model, i) bind(C)
      import
      type(c_ptr), value :: model
      integer(c_int), value :: i
    end function
    subroutine pmalpha_close(model) bind(C)
      import
      type(c_ptr), value :: model
    end subroutine
  end interface
  type(c_ptr) :: model
  character(len=1024) :: path, steps
  character(kind=c_char) :: message(256)
  real(c_double) :: d(3)
  integer :: k, count
  call get_command_argument(1, path)
  call get_command_argument(2, steps)
  read (steps, *) count
  if (pmalpha_open(trim(path)//c_null_char, message, model) /= 0) stop 1
  do k = 1, count
    if (pmalpha_command(model, 0_c_int, d) < 0) stop 1
    if (pmalpha_set(model, 0_c_int, 300.0_c_double * d(1)) /= 0) stop 1
    if (pmalpha_advance(model, 1_c_size_t) /= 0) stop 1
  end do
  print '(es24.16)', pmalpha_get(model, 0_c_int)
  call pmalpha_close(model)
end program
