void main() {
    vec3 v = normalize(eye - world);
    mat3 frame = local_frame();
    float way = way_to_structure(), level = prepare_places(texel);
    vec3 p = world - way * v;
    ray_end end = find_end(frame * v, way);
    frame = end.turn * frame;
#if ALONG
    vec3 shown = shade_along(frame, end, level, p, lamp_at(p));
#else
    vec3 shown = shade(frame, find_places(end.texel, level), end.v, p, lamp_at(p));
#endif
    colour = vec4(gl_FrontFacing ? shown : vec3(0.02), 1.0);
}
