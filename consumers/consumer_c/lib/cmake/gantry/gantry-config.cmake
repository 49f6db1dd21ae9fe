# find_package(gantry): the target gantry::gantry, for C11 and C++17.
get_filename_component(GANTRY_PREFIX "${CMAKE_CURRENT_LIST_DIR}/../../.." REALPATH)
if(NOT TARGET gantry::gantry)
  add_library(gantry::gantry SHARED IMPORTED)
  set_target_properties(gantry::gantry PROPERTIES
    IMPORTED_LOCATION "${GANTRY_PREFIX}/lib/libgantry.so.1"
    IMPORTED_SONAME "libgantry.so.1"
    INTERFACE_INCLUDE_DIRECTORIES "${GANTRY_PREFIX}/include"
    INTERFACE_COMPILE_FEATURES "cxx_std_17")
endif()
