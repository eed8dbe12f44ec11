layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec4 tangent;
layout(location = 3) in vec2 uv;

uniform mat4 projection; // of world coordinates
uniform vec2 tiles;

out vec3 world;
out vec3 frame_n;
out vec4 frame_t;
out vec2 texel;

void main() {
    world = position;
    frame_n = normal;
    frame_t = tangent;
    // v runs up, a texture's rows run down.
    texel = vec2(uv.x, -uv.y) * tiles;
    gl_Position = projection * vec4(position, 1.0);
}
