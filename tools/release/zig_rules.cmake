# How zig archives and links, whatever CMake knows of the system.
set(CMAKE_C_ARCHIVE_CREATE "\"${INKLOOP_ZIG}\" ar qcD <TARGET> <LINK_FLAGS> <OBJECTS>")
set(CMAKE_C_ARCHIVE_APPEND "\"${INKLOOP_ZIG}\" ar qD <TARGET> <LINK_FLAGS> <OBJECTS>")
set(CMAKE_C_ARCHIVE_FINISH "\"${INKLOOP_ZIG}\" ranlib -D <TARGET>")
foreach(kind LIBRARY MODULE)
  set(CMAKE_SHARED_${kind}_CREATE_C_FLAGS "-shared")
  set(CMAKE_C_CREATE_SHARED_${kind}
      "<CMAKE_C_COMPILER> <CMAKE_SHARED_${kind}_C_FLAGS> <LANGUAGE_COMPILE_FLAGS> <LINK_FLAGS> <CMAKE_SHARED_${kind}_CREATE_C_FLAGS> -o <TARGET> <OBJECTS> <LINK_LIBRARIES>")
endforeach()
