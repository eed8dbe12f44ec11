// Eigen-maps in a 3D texture (Wang et al. 2005 §5); see eigenmaps_volume.h.
//   BTF(x, v, l) = Σ_i W_i(v) ((1 − s) E(x, a_i) + s E(x, b_i))
// W_i is the weight of term i. a_i and b_i are the slices of term i on the two nearest rings of
// lights, and s is the position of the light between these rings.
uniform sampler3D maps_volume;
uniform sampler2DArray view_weights;
uniform int n_terms;
uniform int n_slices; // number of slices of a term; the last slice is for the light of an even sky
uniform int light_rings;
uniform vec4 light_ring[16]; // see gl/ring_slices.h

#define BTF_PREPARED
vec2 view_at;        // coordinates of the view in the table of W_i
vec3 light_at;       // a and b of term 0, in slices; s
float light_arrives; // share of the light that arrives

void btf_prepare(vec3 v, vec3 l, float lit) {
    vec2 table = vec2(textureSize(view_weights, 0).xy);
    view_at = (square(v) * (table - 1.0) + 0.5) / table;
    float theta = acos(clamp(l.z, 0.0, 1.0)), turns = atan(l.y, l.x) / 6.28318531;
    int k = 0;
    while (k < light_rings - 2 && light_ring[k + 1].x < theta)
        k++;
    vec4 upper = light_ring[k], lower = light_ring[min(k + 1, light_rings - 1)];
    light_at =
        vec3(upper.y + upper.z * fract(turns - upper.w), lower.y + lower.z * fract(turns - lower.w),
             clamp((theta - upper.x) / max(lower.x - upper.x, 1e-6), 0.0, 1.0));
    // Reflectance, which contains n·l, falls to 0 from the lowest ring to the horizon.
    light_arrives = lit * clamp(l.z / max(cos(light_ring[light_rings - 1].x), 1e-6), 0.0, 1.0);
}

vec3 map_at(vec2 x, float slice) {
    vec3 size = vec3(textureSize(maps_volume, 0));
#if NEAREST
    x = (floor(x * size.xy) + 0.5) / size.xy;
#endif
    return textureLod(maps_volume, vec3(x, slice / size.z), 0.0).rgb;
}

vec3 btf_texel(vec2 x) {
    vec3 sum = vec3(0.0);
    for (int i = 0; i < n_terms; i++) {
        float first = float(i * n_slices);
        vec3 e = light_arrives *
                 mix(map_at(x, first + light_at.x), map_at(x, first + light_at.y), light_at.z);
        if (ambient > 0.0)
            e += ambient * map_at(x, first + float(n_slices) - 0.5);
        sum += textureLod(view_weights, vec3(view_at, float(i / 4)), 0.0)[i & 3] * e;
    }
    return max(sum, vec3(0.0));
}

vec3 btf(vec2 x, vec3 v, vec3 l, float lit) {
    btf_prepare(v, l, lit);
    return btf_texel(x);
}
