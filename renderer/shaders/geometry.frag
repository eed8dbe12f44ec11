// Outputs the values with which code outside the GPU shades a sample; see viewer_render_geometry().
// The light is that of the first lamp. With FURTHER it is that of the first further lamp.
uniform int which;      // enum viewer_geometry
uniform float material; // 1 + the number of the material

void main() {
    mat3 frame = local_frame();
    vec3 v = normalize(eye - world);
    float way = way_to_structure();
    vec3 p = world - way * v;
#if FURTHER
    float lit;
    vec3 l = towards_lamp(0, p, lit);
    lit *= further_at(0, p);
#else
    vec3 l = light;
    float lit = lamp_at(p);
#endif
    ray_end end = find_end(frame * v, way);
    vec3 shown = which == 0   ? vec3(end.texel, gl_FrontFacing ? material : 0.0)
                 : which == 1 ? end.v
                 : which == 2 ? end.turn * frame * l
                              : vec3(lit, way, length(eye - world));
    colour = vec4(shown, 1.0);
}
