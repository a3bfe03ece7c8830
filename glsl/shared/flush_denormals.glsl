// Makes 0 of 32-bit denormals: execution mode DenormFlushToZero of the capability of the same name. A device without it
// gets the shader without this mode (src/gpu/denormals.rs).
#extension GL_EXT_spirv_intrinsics : require
spirv_execution_mode(extensions = ["SPV_KHR_float_controls"], capabilities = [4465], 4460, 32);
