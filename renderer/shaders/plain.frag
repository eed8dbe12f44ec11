// Draws a plain textured mesh: one picture, times n·l. Eigen-maps are compared with it.
uniform sampler2DArray maps;
uniform int n_layers;

void main() {
    vec3 l = local_frame() * light;
    vec3 shown =
        texture(maps, vec3(texel, float(n_layers - 1))).rgb * (max(l.z, 0.0) + ambient_light);
    colour = vec4(gl_FrontFacing ? abs(shown) : vec3(0.02), 1.0);
}
