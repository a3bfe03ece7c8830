// Entries that a workgroup sorts: as many as the device's workgroup memory holds.
layout(constant_id = 9) const uint BIN_RUN = 2048;
