// Draws stripes where the nearest planned view is missing; see hatching.h.
uniform sampler2D seen_from; // unit vectors in the local frame; w is 0 for the background
uniform sampler2D missing;   // over the hemisphere: 1 where the nearest view is missing

out vec4 colour;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 v = texelFetch(seen_from, pixel, 0);
    int across = (pixel.x + pixel.y) % 8;
    if (v.w == 0.0 || across > 1 || texture(missing, square(v.xyz)).r < 0.5)
        discard;
    colour = across == 0 ? vec4(1.0, 0.45, 0.1, 0.55) : vec4(0.0, 0.0, 0.0, 0.35);
}
