// Finds the nearest back faces beyond the back faces of the previous layer (Wang et al. 2005 fig.
// 7). The result is the distance from the eye to the back face, and the distance along the ray from
// the back face back to the structure.
uniform sampler2D before; // result of the previous layer
uniform sampler2D seen;   // surfaces found so far

void main() {
    float z = distance_from_eye(), level = level_of_detail();
    ivec2 at = ivec2(gl_FragCoord.xy);
    if (texelFetch(seen, at, 0).a > 0.5 || z <= texelFetch(before, at, 0).r)
        discard;
    colour = vec4(z, below_mesh(local_frame() * -towards_eye(), level).hit, 0.0, 1.0);
}
