void main() {
    vec3 v = normalize(eye - world);
    mat3 frame = local_frame();
    float way = way_to_structure();
    vec3 p = world - way * v;
#if CURVED
    ray_end end = find_end(frame * v, way);
    vec3 shown = shade(end.turn * frame, end.texel, end.v, p, lamp_at(p));
#else
    vec3 shown = shade(frame, texel, frame * v, p, lamp_at(p));
#endif
    colour = vec4(gl_FrontFacing ? shown : vec3(0.02), 1.0);
}
