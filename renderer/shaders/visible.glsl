// Decides which fragments are seen if silhouettes show the structure of the material
// (visibility.h).
uniform sampler2D seen;   // r: distance from the eye to the mesh; g: from the mesh to the structure
uniform bool silhouettes; // if FALSE, all fragments are seen
uniform float slack;      // tolerance of distances from the eye

// Returns the distance from the mesh along the ray to the structure. With silhouettes, discards the
// fragment if it lies on a back face, or if the pixel shows another surface. Without silhouettes,
// returns 0.
float way_to_structure() {
    if (!silhouettes)
        return 0.0;
    vec4 first = texelFetch(seen, ivec2(gl_FragCoord.xy), 0);
    if (!gl_FrontFacing || abs(length(eye - world) - first.r) > slack)
        discard;
    return first.g;
}
