# find_package(pmalpha) makes the target pmalpha::pmalpha.
if(NOT TARGET pmalpha::pmalpha)
  get_filename_component(_prefix "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)
  add_library(pmalpha::pmalpha SHARED IMPORTED)
  set_target_properties(pmalpha::pmalpha PROPERTIES
    IMPORTED_LOCATION "${_prefix}/lib/libpmalpha.so"
    INTERFACE_INCLUDE_DIRECTORIES "${_prefix}/include")
  unset(_prefix)
endif()
