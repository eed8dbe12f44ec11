void main() {
    mat3 frame = local_frame();
    vec3 shown = shade(frame, frame * normalize(eye - world), 1.0);
    colour = vec4(gl_FrontFacing ? shown : vec3(0.02), 1.0);
}
