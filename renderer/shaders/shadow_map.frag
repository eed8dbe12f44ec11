// Outputs the depth for a shadow map: the depth of the base of the structure (Wang et al. 2005
// §4.2). The shadows of the structure on itself are already in the BTF.
uniform sampler2D seen; // visibility from the light; see visibility.h
uniform float range;    // length from depth 0 to depth 1

void main() {
    vec4 first = texelFetch(seen, ivec2(gl_FragCoord.xy), 0);
    gl_FragDepth = first.w > 0.5 ? clamp((first.r + first.b) / range, 0.0, 1.0) : 1.0;
}
