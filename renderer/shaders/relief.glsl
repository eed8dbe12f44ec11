// The distance that a viewing ray travels below the mesh until it meets the material's structure,
// from the mesostructure distance function (Wang et al. 2005 §3 and §4.1).
// Depths below the reference plane, with a layer per view, or with four maps per layer; see
// mdf_factors.h.
uniform sampler2DArray mdf_depths;
uniform vec2 mdf_range; // for views, mm: depth = x + y · texel value
uniform int mdf_layers; // number of layers of maps; 0 if there are views
uniform sampler2DArray
    mdf_factors; // weights of the maps over the hemisphere (mdf_factors.h); the last layer has W_0
uniform usampler2D
    mdf_indices; // indices of measured views over the hemisphere; see direction_table.h
uniform sampler2D mdf_weights;
uniform float mdf_deepest; // depth of the deepest structure, mm

const float MIN_SLOPE = 0.01;
const int CHORDS = 3;

#ifdef MDF_VOLUME
uniform sampler3D mdf_volume; // distances of views, as shares of mdf_longest; see mdf_texture.h
uniform float mdf_longest;
uniform int mdf_rings;
// θ in rad, centre of the first slice, number of views, and φ of the first view in turns
uniform vec4 mdf_ring[16];
#endif

struct below {
    float hit;  // distance along the ray from the mesh to the structure
    float base; // distance to the point where the ray is as deep as the deepest structure
};

#ifndef MDF_SHELL
// Returns the mip level for one of the two axes of the screen: the axis along which the texture
// coordinates change less. Near a contour, they change without limit along the other axis. A level
// for that axis would smooth the relief away. A volume has only level 0.
float level_of_detail() {
#ifdef MDF_VOLUME
    return 0.0;
#else
    vec2 size = vec2(textureSize(mdf_depths, 0).xy);
    vec2 a = dFdx(texel) * size, b = dFdy(texel) * size;
    return max(0.5 * log2(min(dot(a, a), dot(b, b)) + 1e-8), 0.0);
#endif
}

#if MDF_MAPS
float sum_of_maps(vec2 x, vec2 at, float level) {
    vec2 table = vec2(textureSize(mdf_factors, 0).xy);
    vec2 way = (at * (table - 1.0) + 0.5) / table;
    float depth = textureLod(mdf_factors, vec3(way, float(mdf_layers)), 0.0).r;
    for (int layer = 0; layer < mdf_layers; layer++)
        depth += dot(textureLod(mdf_factors, vec3(way, float(layer)), 0.0),
                     textureLod(mdf_depths, vec3(x, float(layer)), level));
    return depth;
}
#endif

#ifdef MDF_VOLUME
float distance_in_ring(vec2 x, vec4 ring, float turns) {
    float slice = ring.y + ring.z * fract(turns - ring.w);
    return texture(mdf_volume, vec3(x, slice / float(textureSize(mdf_volume, 0).z))).r;
}

float depth_in_volume(vec2 x, vec3 d) {
    float theta = acos(clamp(d.z, 0.0, 1.0)), turns = atan(d.y, d.x) / 6.28318531;
    int k = 0;
    while (k < mdf_rings - 2 && mdf_ring[k + 1].x < theta)
        k++;
    vec4 upper = mdf_ring[k], lower = mdf_ring[min(k + 1, mdf_rings - 1)];
    float share = clamp((theta - upper.x) / max(lower.x - upper.x, 1e-6), 0.0, 1.0);
    float distance =
        mix(distance_in_ring(x, upper, turns), distance_in_ring(x, lower, turns), share);
    return min(mdf_longest * distance * d.z, mdf_deepest);
}
#endif

float depth_mm(vec2 x, vec3 d, float level) {
#ifdef MDF_VOLUME
    return depth_in_volume(x, d);
#else
    vec2 at = square(d);
#if MDF_MAPS
    return clamp(sum_of_maps(x, at, level), 0.0, mdf_deepest);
#else
    ivec2 cells = textureSize(mdf_indices, 0);
    ivec2 cell = min(ivec2(at * vec2(cells)), cells - 1);
    uvec4 index = texelFetch(mdf_indices, cell, 0);
    vec4 share = texelFetch(mdf_weights, cell, 0);
    float depth = share.x * textureLod(mdf_depths, vec3(x, float(index.x)), level).r;
    depth += share.y * textureLod(mdf_depths, vec3(x, float(index.y)), level).r;
    depth += share.z * textureLod(mdf_depths, vec3(x, float(index.z)), level).r;
    depth += share.w * textureLod(mdf_depths, vec3(x, float(index.w)), level).r;
    return mdf_range.x + mdf_range.y * depth;
#endif
#endif
}

float depth_at(places at, vec3 d, float level) {
#if PLACES == 1
    float depth = 0.0;
    for (int k = 0; k < at.n; k++)
        depth += at.share[k] * depth_mm(at.x[k], d, level);
    return depth;
#else
    return depth_mm(at.x[0], d, level);
#endif
}

// Returns the step on the mesh that lies above a step x, if x is at this depth below a curved mesh.
// Along a principal direction with curvature κ, the distance between two normals of the mesh
// changes with depth by the factor 1 − depth · κ. The step is therefore divided by this factor.
// Below the depth at which normals meet, returns x unchanged.
vec2 texture_step(vec2 x, float depth) {
    mat2 shrunk = mat2(1.0) - depth * mat2(bending.x, bending.y, bending.y, bending.z);
    return determinant(shrunk) > 0.0 ? inverse(shrunk) * x : x;
}

// Returns the normal curvature of the mesh along v.
float bend_along(vec3 v) {
    return straight ? 0.0
                    : bending.x * v.x * v.x + 2.0 * bending.y * v.x * v.y + bending.z * v.y * v.y;
}

// Returns the distance after which a ray is as deep as the deepest structure, or 1e30 if the ray
// never gets so deep. v is the unit vector outwards along the ray, in the frame of the mesh. With
// the normal curvature κ of the mesh, a straight ray is at the depth t v_z − ½ κ t² after the
// distance t.
float way_to_base(vec3 v) {
    float slope = max(v.z, MIN_SLOPE), deepest = mdf_deepest * mesh_mm().z;
    float root = slope * slope - 2.0 * bend_along(v) * deepest;
    return root > 0.0 ? 2.0 * deepest / (slope + sqrt(root)) : 1e30;
}

// Returns where a ray meets the structure, and where it meets the base. Seen from the mesh, the ray
// is the parabola of way_to_base(). The MDF is known only for straight rays over a flat surface.
// Therefore CHORDS chords of this parabola are tested, or one chord if the mesh is flat along the
// ray.
//
// All chords start where the ray enters. The last chord ends where the ray is as deep as the
// deepest structure, or at the deepest point of the ray. A chord lies above the parabola. If the
// chord meets a structure before its end, the ray also meets this structure. Along the texture, a
// chord has the length that texture_step() returns for its far end, at the depth chord · end.
below below_mesh(vec3 v, float level) {
    vec3 mm = mesh_mm();
    mm.xy = straight ? mm.zz : mm.xy;
    float bend = bend_along(v), slope = max(v.z, MIN_SLOPE), base = way_to_base(v);
    float middle = base < 1e30 ? base : slope / bend;
    base = base < 1e30 ? base : 2.0 * middle;
#if PLACES == 2
    places at = nearest_place(texel);
#else
    places at = find_places(texel, level);
#endif
    float hit = 1e30;
    for (int k = bend == 0.0 ? CHORDS : 1; k <= CHORDS; k++) {
        float end = middle * float(k) / float(CHORDS), chord = slope - 0.5 * bend * end;
        vec2 along = straight ? v.xy : texture_step(v.xy, chord * end);
        float met = depth_at(at, normalize(vec3(along, chord) / mm), level) * mm.z / chord;
        if (met <= end || k == CHORDS) {
            hit = met;
            break;
        }
    }
    return below(hit, mdf_deepest > 0.0 ? base : 1e30);
}

#endif
