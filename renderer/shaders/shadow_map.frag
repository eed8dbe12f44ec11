// The shadow map's depth, measured from the base of the structure (Wang et al. 2005 §4.2): the structure's
// own shadows are in the BTF already.
uniform sampler2D seen; // from the light; see visibility.h
uniform float range;

void main() {
    vec4 first = texelFetch(seen, ivec2(gl_FragCoord.xy), 0);
    gl_FragDepth = first.w > 0.5 ? clamp((first.r + first.b) / range, 0.0, 1.0) : 1.0;
}
