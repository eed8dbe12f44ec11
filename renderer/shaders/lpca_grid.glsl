// Eigen-BRDFs over a grid of the hemisphere's square, for views and for lights; see lpca_grid.h.
uniform sampler2DArray brdfs; // x: light cell · (n_components + 1) + component, y, layer: see row()
uniform int n_grid;           // samples each way; the light cell n_grid² is an even sky
uniform int clusters_a_layer;

// The corners of the simplex around (v, l), and how much of each.
ivec2 corners[5]; // view cell, light cell
float shares[5];
float lit_share;
// Of the triangle around v alone.
int view_corners[3];
float view_shares[3];

// Corners of the simplex in which a point of the unit cube lies: those of its coordinates are
// stepped first that are largest.
void prepare(vec3 v, vec3 l, float lit) {
    vec4 place = vec4(square(v), square(l)) * float(n_grid - 1);
    vec4 base = min(floor(place), float(n_grid - 2)), r = place - base;
    vec4 rank = vec4(0.0);
    rank.x = step(r.x, r.y) + step(r.x, r.z) + step(r.x, r.w);
    rank.y = 1.0 - step(r.x, r.y) + step(r.y, r.z) + step(r.y, r.w);
    rank.z = 2.0 - step(r.x, r.z) - step(r.y, r.z) + step(r.z, r.w);
    rank.w = 3.0 - step(r.x, r.w) - step(r.y, r.w) - step(r.z, r.w);
    float before = 1.0;
    for (int k = 0; k < 5; k++) {
        vec4 at = base + vec4(lessThan(rank, vec4(float(k))));
        float next = dot(r, vec4(equal(rank, vec4(float(k)))));
        corners[k] = ivec2(int(at.x) * n_grid + int(at.y), int(at.z) * n_grid + int(at.w));
        shares[k] = before - next;
        before = next;
    }
    lit_share = lit * step(0.0, l.z);
    ivec2 cell = ivec2(base.xy);
    bool steep = r.x >= r.y;
    view_corners[0] = cell.x * n_grid + cell.y;
    view_corners[1] = view_corners[0] + (steep ? n_grid : 1);
    view_corners[2] = view_corners[0] + n_grid + 1;
    view_shares[0] = 1.0 - max(r.x, r.y);
    view_shares[2] = min(r.x, r.y);
    view_shares[1] = 1.0 - view_shares[0] - view_shares[2];
}

vec3 one_corner(int cluster, vec4 w[MAX_PAGES], int view, int light_cell) {
    ivec3 at = ivec3(light_cell * (n_components + 1),
                     cluster % clusters_a_layer * n_grid * n_grid + view,
                     cluster / clusters_a_layer);
    vec3 sum = texelFetch(brdfs, at, 0).rgb;
    for (int i = 0; i < n_components; i++)
        sum += w[i >> 2][i & 3] * texelFetch(brdfs, at + ivec3(i + 1, 0, 0), 0).rgb;
    return sum;
}

vec3 evaluate(int cluster, vec4 w[MAX_PAGES]) {
    vec3 sum = vec3(0.0);
    if (lit_share > 0.0)
        for (int k = 0; k < 5; k++)
            sum += lit_share * shares[k] * one_corner(cluster, w, corners[k].x, corners[k].y);
    if (ambient > 0.0)
        for (int k = 0; k < 3; k++)
            sum += ambient * view_shares[k] *
                   one_corner(cluster, w, view_corners[k], n_grid * n_grid);
    return sum;
}
