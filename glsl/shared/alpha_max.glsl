// The upper limit of alphas, a rule of the picture: src/rules.rs has its source.

layout(constant_id = 18) const float ALPHA_MAX = 0.99;  // of a splat at a pixel
