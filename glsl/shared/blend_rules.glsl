// The rules of the picture that every blend follows: rules.rs has their meaning and sources.

layout(constant_id = 18) const float ALPHA_MAX = 0.99;          // no splat covers more
layout(constant_id = 19) const float TRANSMITTANCE_MIN = 1e-4;  // the splat that would take T below is not added
layout(constant_id = 20) const float STOP = 0.0;                // a pixel is finished once T is below
