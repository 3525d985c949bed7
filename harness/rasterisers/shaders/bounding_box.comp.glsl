// Test each pixel centre in the triangle's bounding box, like software rasterisers on GPUs.

void main() {
    if (get_job() >= number) return;
    Triangle t = load_triangle(jobs[get_job()]);
    ivec2 box = max(t.last - t.first + 1, ivec2(0));
    uint tests = 0u;
    uint hits = 0u;
    for (int i = int(gl_LocalInvocationIndex); i < box.x * box.y; i += 32) {
        ivec2 pixel = t.first + ivec2(i % box.x, i / box.x);
        tests++;
        if (t.solid && evaluate(t.edges[0], pixel.x, pixel.y) >= 0L
                    && evaluate(t.edges[1], pixel.x, pixel.y) >= 0L
                    && evaluate(t.edges[2], pixel.x, pixel.y) >= 0L) {
            hits++;
#ifndef COUNT
            imageStore(picture, pixel, uvec4(colour(t.polygon)));
#endif
        }
    }
#ifdef COUNT
    atomicAdd(counts[2u * t.polygon], tests);
    atomicAdd(counts[2u * t.polygon + 1u], hits);
#endif
}
