// A neutral ground that fades into the distance, and darkens softly under the mesh.
uniform mat4 projection;
uniform vec3 eye;
// half the size of the mesh's footprint in x and in y, and the lowest z of the mesh
uniform vec3 foot;
uniform float corner; // radius of the corners of the footprint, which is a rectangle
uniform float radius; // radius of the mesh

uniform vec3 light; // unit vector towards the first lamp
uniform float lamp; // brightness of the first lamp

in vec2 at;
out vec4 colour;

const float DISTANT = 0.022, NEAR = 0.105, SHADOW = 0.35;

// Returns the share of the irradiance of all lamps that is not shadowed at p, 0 … 1.
float arriving(vec3 p) {
#if LAMP_SHADOWS
    float all = lamp * max(light.z, 0.0), sum = all * lamp_at(p);
    for (int k = 0; k < n_lamps; k++) {
        float shines, up = max(towards_lamp(k, p, shines).z, 0.0);
        float one = dot(lamp_colours[k], vec3(1.0 / 3.0)) * up * shines;
        all += one;
        sum += one * further_at(k, p);
    }
    return all > 0.0 ? sum / all : 1.0;
#else
    return lamp_at(p);
#endif
}

void main() {
    vec4 far = inverse(projection) * vec4(2.0 * at - 1.0, 1.0, 1.0);
    vec3 ray = normalize(far.xyz / far.w - eye);
    float ground = foot.z - 0.002 * radius;
    float along = ray.z < -1e-4 ? (ground - eye.z) / ray.z : 0.0;
    float shown = DISTANT;
    if (along > 0.0) {
        vec2 hit = eye.xy + along * ray.xy;
        vec2 beyond = max(abs(hit) - (foot.xy - corner), 0.0);
        float away = max(length(beyond) - corner, 0.0) / radius;
        float lit = mix(DISTANT, NEAR, exp(-0.35 * dot(hit, hit) / (radius * radius)));
        shown = lit * (1.0 - 0.75 * exp(-away / 0.22));
        shown *= mix(SHADOW, 1.0, arriving(vec3(hit, ground)));
    }
    colour = vec4(vec3(shown), 0.0);
}
