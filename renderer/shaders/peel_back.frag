// The nearest back faces beyond those of the layer before (seed 004 fig. 7): distance from the eye,
// and from there back to the structure.
uniform sampler2D before; // as this

void main() {
    float z = distance_from_eye(), level = level_of_detail();
    if (z <= texelFetch(before, ivec2(gl_FragCoord.xy), 0).r)
        discard;
    colour = vec4(z, below_mesh(local_frame() * -towards_eye(), level).hit, 0.0, 1.0);
}
