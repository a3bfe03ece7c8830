// The size of the parts of a scene that the stage `examine` reports on.

const uint EXAMINED_GAUSSIANS = 2048;
