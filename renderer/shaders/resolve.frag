// Averages samples × samples samples of the drawn picture into one sRGB pixel. Exposure and tone
// curve are applied to each sample before the mean.
uniform sampler2D drawn;
uniform int samples;
uniform float exposure;

in vec2 at;
out vec4 colour;

void main() {
    ivec2 corner = ivec2(gl_FragCoord.xy) * samples;
    vec3 sum = vec3(0.0);
    for (int j = 0; j < samples; j++)
        for (int i = 0; i < samples; i++) {
            // Alpha 0 marks the background, which is not exposed.
            vec4 one = texelFetch(drawn, corner + ivec2(i, j), 0);
            sum += tone(one.rgb * (one.a > 0.5 ? exposure : 1.0));
        }
    vec3 shown = srgb(sum / float(samples * samples)) + noise(gl_FragCoord.xy) / 255.0;
    colour = vec4(shown, 1.0);
}
