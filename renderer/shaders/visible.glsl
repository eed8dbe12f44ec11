// Which fragments are seen once the structure of the material counts; see visibility.h.
uniform sampler2D seen;
uniform bool silhouettes; // FALSE: all fragments are seen
uniform float slack;      // of distances from the eye

// From the mesh along the ray to the structure.
float way_to_structure() {
    if (!silhouettes)
        return 0.0;
    vec4 first = texelFetch(seen, ivec2(gl_FragCoord.xy), 0);
    if (!gl_FrontFacing || abs(length(eye - world) - first.r) > slack)
        discard;
    return first.g;
}
