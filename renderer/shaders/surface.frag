void main() {
    if (!gl_FrontFacing) {
        colour = vec4(vec3(0.02), 1.0);
        return;
    }
    mat3 frame = local_frame();
    places at = find_places(texel, prepare_places(texel));
    colour = vec4(shade(frame, at, frame * normalize(eye - world), world, 1.0), 1.0);
}
