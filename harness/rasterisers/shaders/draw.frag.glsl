// Draw for timing: one colour, and `work` rounds of arithmetic that compilers cannot remove. With
// TEXTURE the colour is multiplied by the mean of `lookups` texture samples. The texture has 1.5
// texels per pixel, so that each sample interpolates between two mip levels.

flat in vec4 colour;

uniform int work;
#ifdef TEXTURE
uniform sampler2D content;
uniform int lookups;
#endif

out vec4 fragment;

void main() {
    float value = gl_FragCoord.x;
    for (int i = 0; i < work; i++) {
        value = fract(value * 1.618034 + 0.1);
    }
    // Too small to show in 8 bits.
    fragment = colour + vec4(work > 0 ? value * 1e-7 : 0.0);
#ifdef TEXTURE
    vec2 position = gl_FragCoord.xy * 1.5 / vec2(textureSize(content, 0));
    vec3 sum = vec3(0.0);
    for (int i = 0; i < lookups; i++) {
        sum += texture(content, position + float(i) * vec2(0.618, 0.414)).rgb;
    }
    fragment.rgb *= sum / float(lookups);
#endif
}
