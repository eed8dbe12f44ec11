layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec4 tangent;
layout(location = 3) in vec2 uv;
layout(location = 4) in vec2 scale;   // length of a step of 1 in u and in v
layout(location = 5) in vec3 bend;    // second fundamental form along tangent and bitangent
layout(location = 6) in vec4 stretch; // gradients of ln scale along tangent and bitangent

uniform mat4 projection; // from world coordinates
uniform vec2 tiles;

invariant gl_Position; // sure_front.frag and list_add.frag compare depths

out vec3 world;
out vec3 frame_n;
out vec4 frame_t;
out vec2 texel;
out vec2 tile_size; // length of a tile along u and along v
out vec3 bending;
out vec4 stretching;

void main() {
    world = position;
    frame_n = normal;
    frame_t = tangent;
    tile_size = scale / tiles;
    bending = bend;
    stretching = stretch;
    // v increases upwards, and the rows of a texture run downwards.
    texel = vec2(uv.x, -uv.y) * tiles;
    gl_Position = projection * vec4(position, 1.0);
}
