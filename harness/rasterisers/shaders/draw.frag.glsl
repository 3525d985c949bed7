// Draw for timing: one colour, and `work` rounds of arithmetic that compilers cannot remove.

flat in vec4 colour;

uniform int work;

out vec4 fragment;

void main() {
    float value = gl_FragCoord.x;
    for (int i = 0; i < work; i++) {
        value = fract(value * 1.618034 + 0.1);
    }
    // Too small to show in 8 bits.
    fragment = colour + vec4(work > 0 ? value * 1e-7 : 0.0);
}
