# loop.jl - a frozen model in Julia: prints the first output after some fine steps.
#
#     julia loop.jl libpmalpha.so model.pma 1000
using Libdl

library = dlopen(ARGS[1])
f(name) = dlsym(library, name)
model, why, d = Ref{Ptr{Cvoid}}(), zeros(UInt8, 256), zeros(3)
status = ccall(f(:pmalpha_open), Cint, (Cstring, Ptr{UInt8}, Ptr{Ptr{Cvoid}}), ARGS[2], why, model)
status == 0 || error(unsafe_string(pointer(why)))
for _ in 1:parse(Int, ARGS[3])
    ccall(f(:pmalpha_command), Cint, (Ptr{Cvoid}, Cint, Ptr{Cdouble}), model[], 0, d)
    r = 300.0 * d[1]
    ccall(f(:pmalpha_set), Cint, (Ptr{Cvoid}, Cint, Cdouble), model[], 0, r) == 0 || error("failed")
    ccall(f(:pmalpha_advance), Cint, (Ptr{Cvoid}, Csize_t), model[], 1) == 0 || error("failed")
end
println(ccall(f(:pmalpha_get), Cdouble, (Ptr{Cvoid}, Cint), model[], 0))
ccall(f(:pmalpha_close), Cvoid, (Ptr{Cvoid},), model[])
