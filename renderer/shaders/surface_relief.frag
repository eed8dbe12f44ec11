void main() {
    vec3 v = normalize(eye - world);
    mat3 frame = local_frame();
    vec3 p = world - way_to_structure() * v;
    vec3 shown = shade(frame, frame * v, p, lamp_at(p));
    colour = vec4(gl_FrontFacing ? shown : vec3(0.02), 1.0);
}
