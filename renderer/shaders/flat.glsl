// One tile of a material, seen flat; see viewer_render_flat().
in vec2 at;

uniform vec3 to_view, to_light;

const float ambient = 0.0;

out vec4 colour;
