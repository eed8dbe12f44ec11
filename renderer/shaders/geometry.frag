// What shading elsewhere needs; see view_render_geometry().
uniform int which;

void main() {
    mat3 frame = local_frame();
    vec3 shown = which == 0   ? vec3(texel, gl_FrontFacing ? 1.0 : 0.0)
                 : which == 1 ? frame * normalize(eye - world)
                              : frame * light;
    colour = vec4(shown, 1.0);
}
