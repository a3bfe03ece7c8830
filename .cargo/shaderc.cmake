# Makes the C++ of shaderc-sys quick to build: no optimization, precompiled headers, and only the libraries that are used.
if(CMAKE_HOST_WIN32)
  return()
endif()

set(CMAKE_CXX_FLAGS_RELEASE "-O0 -DNDEBUG" CACHE STRING "")
set(CMAKE_C_FLAGS_RELEASE "-O0 -DNDEBUG" CACHE STRING "")
set(SKIP_SPIRV_TOOLS_INSTALL ON CACHE BOOL "")
set(GLSLANG_ENABLE_INSTALL OFF CACHE BOOL "")
set(SHADERC_SKIP_EXAMPLES ON CACHE BOOL "")
set(CMAKE_PROJECT_native-shaderc_INCLUDE "${CMAKE_CURRENT_LIST_DIR}/shaderc-targets.cmake")
