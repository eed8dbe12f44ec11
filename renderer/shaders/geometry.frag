// Outputs what code outside the GPU needs to shade a sample; see viewer_render_geometry().
uniform int which;

void main() {
    mat3 frame = local_frame();
    vec3 v = normalize(eye - world);
    float way = way_to_structure();
    vec3 shown = which == 0   ? vec3(texel, gl_FrontFacing ? 1.0 : 0.0)
                 : which == 1 ? frame * v
                 : which == 2 ? frame * light
                              : vec3(lamp_at(world - way * v), way, length(eye - world));
    colour = vec4(shown, 1.0);
}
