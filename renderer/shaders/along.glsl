// Interpolation between measured views along the surface. Before this, the shell has shown where a
// ray ends. If all views were read at the same texel, each view would show another point of the
// surface, and the mixture would have ghosts. Instead, each view k is read at the texel x_k in
// which this view sees the end p of the ray. p is at depth z below f, the point of the mesh that is
// nearest to p:
//
//   x_k = f + z · (xy of v_k) / v_k.z        v_k: direction of view k
//   q_k = (z − z_k(x_k)) / v_k.z / T         z_k: depths of the MDF; T: size of a texel
//   s_k = 1 for |q_k| ≤ 1, 2 − |q_k| for 1 < |q_k| < 2, and 0 for larger |q_k|
//   B(p, v, l) = Σ_k w_k B(x_k, v_k, l) / Σ_k w_k
//   w_k = max(b_k − DROPPED, 0) (v_k.z)^SHORTER (s_k + UNSEEN)
//
// b_k are barycentric weights of the direction v in the triangulation of the measured views.
// mdf/reprojection.h computes the same, but with more views and with other filters. Here the views
// of one triangle and bilinear filters are used.
uniform usampler2D along_indices; // views of the triangle around a direction; see directions.glsl
uniform sampler2D along_weights;
uniform sampler2D along_views;       // v_k
uniform sampler2DArray along_depths; // depths as shares of along_mm, a layer per view
uniform float along_mm;

// DROPPED: a view with less weight than this is not evaluated, which saves a third of the time that
// three views take. UNSEEN: where no view sees p, the result is a mean of all views. SHORTER: the
// same constant as in mdf/reprojection.c.
const float DROPPED = 0.2, UNSEEN = 0.05, SHORTER = 0.7;

vec3 shade_along(mat3 frame, ray_end end, float places_level, vec3 p, float lit) {
    if (!curved)
        return shade(frame, find_places(end.texel, places_level), end.v, p, lit);
    uvec4 index;
    vec4 share = max(direction_shares(along_indices, along_weights, end.v, index) - DROPPED, 0.0);
    vec2 size = vec2(textureSize(along_depths, 0).xy), dx = place_dx * size, dy = place_dy * size;
    float level = max(0.5 * log2(min(dot(dx, dx), dot(dy, dy)) + 1e-8), 0.0);
    float texel_mm = mdf_size.x / size.x, total = 0.0;
    vec3 sum = vec3(0.0);
    for (int k = 0; k < 4; k++) {
        if (share[k] <= 0.0)
            continue;
        vec3 v = texelFetch(along_views, ivec2(int(index[k]), 0), 0).xyz;
        vec2 x = end.foot + end.depth_mm * vec2(v.x, -v.y) / v.z / mdf_size;
        places at = find_places(x, places_level);
        float z = along_mm * textureLod(along_depths, vec3(at.x[0], float(index[k])), level).r;
        float seen = clamp(2.0 - abs(end.depth_mm - z) / (v.z * texel_mm), 0.0, 1.0);
        float w = share[k] * pow(v.z, SHORTER) * (seen + UNSEEN);
        sum += w * shade(frame, at, v, p, lit);
        total += w;
    }
    return sum / max(total, 1e-6);
}
