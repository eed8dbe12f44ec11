// Joins two finished pictures: side by side, or grey + gain · (second − first); see compose.h.
uniform sampler2D first;
uniform sampler2D second;
uniform bool difference;
uniform float split; // position of the border, in pixels
uniform float gain;

out vec4 colour;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec3 a = texelFetch(first, pixel, 0).rgb, b = texelFetch(second, pixel, 0).rgb;
    float away = abs(gl_FragCoord.x - split);
    vec3 side = away < 1.0 ? vec3(1.0) : (gl_FragCoord.x < split ? a : b);
    colour = vec4(difference ? 0.5 + gain * (b - a) : side, 1.0);
}
