in vec3 world;
in vec3 frame_n;
in vec4 frame_t;
in vec2 texel;

uniform vec3 eye;            // position in world coordinates
uniform vec3 light;          // unit vector towards the first lamp
uniform float ambient_light; // radiance of the even sky

out vec4 colour;

float ambient; // radiance of the sky for this evaluation: ambient_light, or 0 for a further lamp

// Returns the matrix from world to local coordinates. Its rows are the tangent t, the bitangent b
// and the normal n. b is the direction of the texture's +y, which is n × t or −n × t.
mat3 local_frame() {
    vec3 n = normalize(frame_n);
    vec3 t = normalize(frame_t.xyz - dot(frame_t.xyz, n) * n);
    vec3 b = cross(n, t) * (frame_t.w < 0.0 ? -1.0 : 1.0);
    return transpose(mat3(t, b, n));
}
