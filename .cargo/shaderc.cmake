# Builds the C++ of shaderc-sys in two minutes of one core instead of twenty: no optimization, only the library that is
# linked, and many source files per compilation (shaderc-targets.cmake).
set(CMAKE_CXX_FLAGS_RELEASE "-O0 -DNDEBUG" CACHE STRING "")
set(CMAKE_C_FLAGS_RELEASE "-O0 -DNDEBUG" CACHE STRING "")
set(SKIP_SPIRV_TOOLS_INSTALL ON CACHE BOOL "")
set(GLSLANG_ENABLE_INSTALL OFF CACHE BOOL "")
set(ENABLE_PCH OFF CACHE BOOL "")
set(SHADERC_SKIP_INSTALL ON CACHE BOOL "")
set(SHADERC_SKIP_EXAMPLES ON CACHE BOOL "")
set(SHADERC_SKIP_EXECUTABLES ON CACHE BOOL "")
set(SHADERC_SKIP_COPYRIGHT_CHECK ON CACHE BOOL "")
set(CMAKE_PROJECT_native-shaderc_INCLUDE "${CMAKE_CURRENT_LIST_DIR}/shaderc-targets.cmake")
