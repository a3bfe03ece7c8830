// The rules of the picture that every blend follows: src/rules.rs has their meaning and sources.

#include "shared/alpha_max.glsl"
layout(constant_id = 19) const float TRANSMITTANCE_MIN = 1e-4;  // a splat that would take T below this is not added
layout(constant_id = 20) const float STOP = 0.0;                // a pixel stops once T is below this
