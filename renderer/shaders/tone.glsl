// Converts light to the values of a screen.

// Tone curve: linear up to 0.8, then 1 − 0.2 exp((0.8 − x) / 0.2), with a continuous slope.
vec3 tone(vec3 x) {
    return mix(x, 1.0 - 0.2 * exp((0.8 - x) / 0.2), step(0.8, x));
}

vec3 srgb(vec3 x) {
    return mix(12.92 * x, 1.055 * pow(max(x, vec3(1e-6)), vec3(1.0 / 2.4)) - 0.055,
               step(0.0031308, x));
}

// Returns a dither from −0.5 to 0.5, in steps of an 8-bit value. The dither prevents banding
// (interleaved gradient noise), and depends only on the pixel.
float noise(vec2 pixel) {
    return fract(52.9829189 * fract(dot(pixel, vec2(0.06711056, 0.00583715)))) - 0.5;
}
