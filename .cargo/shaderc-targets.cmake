# Runs after shaderc-sys has declared its targets.
function(adapt_targets)
  foreach(target SPIRV-Tools-shared SPIRV-Tools-reduce SPIRV-Tools-link SPIRV-Tools-lint SPIRV-Tools-diff
          shaderc_shared glslc)
    if(TARGET ${target})
      set_target_properties(${target} PROPERTIES EXCLUDE_FROM_ALL ON)
    endif()
  endforeach()
  install(FILES $<TARGET_FILE:shaderc_combined> DESTINATION ${CMAKE_INSTALL_LIBDIR})

  # Files compiled together share their names: in another version other names may clash.
  if(NOT CMAKE_SOURCE_DIR MATCHES "shaderc-sys-0\\.10\\.1/")
    return()
  endif()
  set_target_properties(SPIRV-Tools-static SPIRV-Tools-opt glslang shaderc_util
    PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 16)
  compile_apart(SPIRV-Tools-static spirv-tools/source spirv_reducer_options val/validate_ray_tracing_reorder)
  compile_apart(SPIRV-Tools-opt spirv-tools/source/opt basic_block ir_context local_single_block_elim_pass
    local_single_store_elim_pass mem_pass reduce_load_size)
  compile_apart(glslang glslang/SPIRV SpvBuilder)
endfunction()

function(compile_apart target folder)
  list(TRANSFORM ARGN PREPEND "${CMAKE_SOURCE_DIR}/${folder}/")
  list(TRANSFORM ARGN APPEND ".cpp")
  set_source_files_properties(${ARGN} TARGET_DIRECTORY ${target} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
endfunction()

cmake_language(DEFER CALL adapt_targets)
