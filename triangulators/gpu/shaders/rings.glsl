// Large rings: their corners, and the table of each in one buffer of them all.
layout(local_size_x = LANES) in;

layout(std430, binding = 0) readonly buffer Corners { ivec2 corners[]; };
// For each ring two: (first corner, corners n, w + h of its box, where its table begins), and
// (columns of the table, 1 where ties are broken by density, squares: see trace.glsl, 0).
layout(std430, binding = 1) readonly buffer Jobs { ivec4 jobs[]; };
layout(std430, binding = 2) writeonly buffer Bases { uint bases[]; };  // as in small.glsl
layout(std430, binding = 3) buffer Table { int table[]; };  // [i, j] for pairs i < j
layout(std430, binding = 4) buffer Seen { uint seen[]; };  // of each corner: by how many below it
