// Finds front faces behind which the ray meets the structure for certain. This is so if the ray
// reaches the base of the structure in the first half of its way to the nearest back face.
uniform sampler2D exits; // result of exits.frag; 0 where there is no back face

void main() {
    float z = distance_from_eye(), level = level_of_detail();
    float exit = texelFetch(exits, ivec2(gl_FragCoord.xy), 0).r;
    float way = exit > 0.0 ? exit - z : 1e30;
    vec3 v = local_frame() * towards_eye();
    float base = way_to_base(v);
    if (straight || base > 0.5 * way)
        discard;
    below ray = below(base, mdf_deepest > 0.0 ? base : 1e30);
#ifndef BASE_ONLY // if the distance to the structure is needed
    ray = below_mesh(v, level);
#endif
    colour = vec4(z, min(ray.hit, way), min(ray.base, way), 1.0);
}
