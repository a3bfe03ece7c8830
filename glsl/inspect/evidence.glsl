// What an explanation of a pixel tells of one splat.

struct Evidence {
    float depth;  // as splats are sorted by
    float alpha;  // 0 where the splat is not drawn
    vec3 colour;
};
