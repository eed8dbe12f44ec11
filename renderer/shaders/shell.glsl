// The distance that a viewing ray travels below the mesh until it meets the material's structure,
// by marching through the shell; see mdf/mdf_shell.h.
uniform sampler2DArray mdf_shell; // g (mdf/mdf_shell.h); layer 0 is at the reference plane, and
                                  // further layers lie below
uniform float mdf_most_per_mm;    // σ = mdf_most_per_mm · g⁴
uniform float mdf_top;            // depth above which σ is 0, mm

const float OPAQUE = 0.69314718; // ln 2
const float STEP = 1.5;          // length of a step, in voxels along the texture or in layers
const float BACK_STEP = 3.0;
const int MIN_STEPS = 4, MAX_STEPS = 96;

// Returns the mip level as in relief.glsl: for the axis of the screen along which the texture
// coordinates change less.
float level_of_detail() {
    vec2 size = vec2(textureSize(mdf_shell, 0).xy);
    vec2 a = dFdx(texel) * size, b = dFdy(texel) * size;
    return max(0.5 * log2(min(dot(a, a), dot(b, b)) + 1e-8), 0.0);
}

// Returns g at the place x of the texture. depth is a share of the depth of the shell. Mip levels
// are coarser only along the texture, not along the depth.
float shell_value(vec2 x, float depth, float layers, float level) {
    float w = clamp(depth * layers - 0.5, 0.0, layers - 1.0), upper = floor(w);
    return mix(textureLod(mdf_shell, vec3(x, upper), level).r,
               textureLod(mdf_shell, vec3(x, min(upper + 1.0, layers - 1.0)), level).r, w - upper);
}

vec2 shell_place(vec2 x) {
#if PLACES == 1
    vec2 p = x * index_sample;
    return (p + index_shift(ivec2(floor(p)), 0)) / index_sample;
#elif PLACES == 2
    return nearest_place(x).x[0];
#else
    return x;
#endif
}

// Returns the distance after which a ray is at the depth d below a mesh of normal curvature k, or
// 1e30 if the ray never gets so deep. slope is the cosine of the angle between ray and normal where
// the ray enters.
float distance_to_depth(float d, float slope, float k) {
    float c = 2.0 * d - k * d * d, root = slope * slope - k * c;
    return root >= 0.0 && k * d < 1.0 ? c / (slope + sqrt(root)) : 1e30;
}

// Returns the normal curvature of the mesh along the tangent of v.
float bend_along(vec3 v, mat2 b) {
    return dot(v.xy, b * v.xy) / max(dot(v.xy, v.xy), 1e-6);
}

// Returns the distance after which a ray is as deep as the deepest structure, or 1e30 if the ray
// never gets so deep. v is the unit vector outwards along the ray, in the frame of the mesh.
float way_to_base(vec3 v) {
    mat2 b = mat2(bending.x, bending.y, bending.y, bending.z);
    return distance_to_depth(mdf_deepest * mesh_mm().z, max(v.z, MIN_SLOPE), bend_along(v, b));
}

// Returns where a ray meets the structure, and where it meets the base. v is the unit vector
// outwards along the ray, in the frame of the mesh. The ray is marched to the base. If the ray does
// not reach the base, it is marched to its deepest point. Its other half is then marched from the
// face where it leaves the mesh.
below below_mesh(vec3 v, float level) {
    if (mdf_deepest <= 0.0)
        return below(0.0, 1e30); // a smooth surface
    mat2 b = mat2(bending.x, bending.y, bending.y, bending.z);
    vec3 mm = mesh_mm();
    float slope = max(v.z, MIN_SLOPE), k = bend_along(v, b), deepest = mdf_deepest * mm.z;
    float base = distance_to_depth(deepest, slope, k);
    float middle = base < 1e30 ? base : k > 0.0 ? slope / k : 1e30;
    base = base < 1e30 ? base : 2.0 * middle;
    float from = distance_to_depth(mdf_top * mm.z, slope, k);
    if (from >= 1e30 || middle >= 1e30)
        return below(1e30, base);
    vec3 size = vec3(textureSize(mdf_shell, 0));
    vec3 voxels = vec3(size.xy / tile_size * abs(v.xy), size.z / deepest * slope);
    float longest = max(max(voxels.x, voxels.y), voxels.z) * (middle - from);
    // Far from an edge of the mesh, a ray that reaches the base from one side also reaches the base
    // from the other side. The result for the back face then has no effect, so longer steps are
    // enough.
    float step = !gl_FrontFacing && base == middle ? BACK_STEP : STEP;
    int n = clamp(int(ceil(longest / step)), MIN_STEPS, MAX_STEPS);
    float dt = (middle - from) / float(n), hit = base == middle ? base : 1e30, sum = 0.0;
    marched m = marched(-v.xy, slope, 0.0, vec2(0.0), texel, 0.0);
    for (int i = 0; i < n; i++) {
        float go = i == 0 ? from + 0.5 * dt : dt; // to the middle of step i
        march(m, b, mm, go);
        vec2 grown = grown_at(m.foot);
        float depth = m.depth / (mm.z * sqrt(grown.x * grown.y) * mdf_deepest);
        float g = shell_value(shell_place(m.x), depth, size.z, level);
        float more = mdf_most_per_mm * g * g * g * g * m.mm * dt / go;
        if (sum + more >= OPAQUE || depth >= 1.0) {
            hit = from + dt * (float(i) + (depth >= 1.0 ? 0.5 : (OPAQUE - sum) / more));
            break;
        }
        sum += more;
    }
    return below(max(hit, 1e-9), base);
}
