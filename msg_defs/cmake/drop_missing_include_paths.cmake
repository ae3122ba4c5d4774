# Message packages installed from wheels export the Python include folder of the machine that built
# them, and CMake refuses a target that names a folder which does not exist. Drop those paths; on a
# distribution's ROS all of them exist and nothing changes.
get_property(imported_targets DIRECTORY PROPERTY IMPORTED_TARGETS)
foreach(target IN LISTS imported_targets)
  get_target_property(include_paths ${target} INTERFACE_INCLUDE_DIRECTORIES)
  if(NOT include_paths)
    continue()
  endif()
  set(existing_paths)
  foreach(path IN LISTS include_paths)
    if(NOT IS_ABSOLUTE "${path}" OR EXISTS "${path}")
      list(APPEND existing_paths "${path}")
    endif()
  endforeach()
  set_property(TARGET ${target} PROPERTY INTERFACE_INCLUDE_DIRECTORIES "${existing_paths}")
endforeach()
