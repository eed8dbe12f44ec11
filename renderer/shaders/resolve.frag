// Averages samples × samples of the drawn picture, exposed and toned, into one sRGB pixel.
uniform sampler2D drawn;
uniform int samples;
uniform float exposure;

in vec2 at;
out vec4 colour;

// Tone curve: linear up to 0.8, then 1 − 0.2 exp((0.8 − x) / 0.2), with a continuous slope.
vec3 tone(vec3 x) {
    return mix(x, 1.0 - 0.2 * exp((0.8 - x) / 0.2), step(0.8, x));
}

vec3 srgb(vec3 x) {
    return mix(12.92 * x, 1.055 * pow(max(x, vec3(1e-6)), vec3(1.0 / 2.4)) - 0.055,
               step(0.0031308, x));
}

// Dither of ± half an 8-bit step (interleaved gradient noise) against banding; depends on the pixel only.
float noise(vec2 pixel) {
    return fract(52.9829189 * fract(dot(pixel, vec2(0.06711056, 0.00583715)))) - 0.5;
}

void main() {
    ivec2 corner = ivec2(gl_FragCoord.xy) * samples;
    vec3 sum = vec3(0.0);
    for (int j = 0; j < samples; j++)
        for (int i = 0; i < samples; i++) {
            // Alpha 0: the background, which exposure leaves alone.
            vec4 one = texelFetch(drawn, corner + ivec2(i, j), 0);
            sum += tone(one.rgb * (one.a > 0.5 ? exposure : 1.0));
        }
    vec3 shown = srgb(sum / float(samples * samples)) + noise(gl_FragCoord.xy) / 255.0;
    colour = vec4(shown, 1.0);
}
