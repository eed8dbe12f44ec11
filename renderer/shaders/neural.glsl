// Neural planes; codecs/neural/neural.h defines the formulas, and neural_view.h the textures.
// N_CHANNELS, N_LEVELS, N_RAYS, NEAREST and the numbers of the network are constants. N_RAYS is 1
// for the colour of a point, and 4 for that of a texel. All lengths are in texels of the mip level
// that is evaluated.
uniform sampler2DArray surface; // four channels per layer, 0 … 1
uniform sampler2D heights;      // bytes, 0 … 255
uniform sampler2DArray planes;  // halves: layers 0 and 1; differences: layers 2 and 3
uniform sampler2DArray skies;   // reflectance under an even sky, for SKY × SKY views
uniform vec2 height_scale;      // height of the byte 0, and step, in texels of level 0

#define SURFACE_INPUTS (N_CHANNELS / 4)
#define INPUTS         (SURFACE_INPUTS + 5) // groups of four: surface, planes, light
#define HIDDEN         8                    // groups of four rows of a layer
#define SKY            3

// The network (codecs/neural/neural_drawing.h). Weights that are constants are faster than weights
// in a uniform block.
const mat4 first[HIDDEN * INPUTS] = mat4[HIDDEN * INPUTS](FIRST_WEIGHTS);
const mat4 second[HIDDEN * HIDDEN] = mat4[HIDDEN * HIDDEN](SECOND_WEIGHTS);
const mat4 third[2 * HIDDEN] = mat4[2 * HIDDEN](THIRD_WEIGHTS);
const vec4 first_biases[HIDDEN] = vec4[HIDDEN](FIRST_BIASES);
const vec4 second_biases[HIDDEN] = vec4[HIDDEN](SECOND_BIASES);
const vec4 third_biases[2] = vec4[2](THIRD_BIASES);

const int MAX_STEPS = 64, HALVINGS = 5;

#define BTF_PREPARED
vec3 prepared_v, prepared_l;
float prepared_lit;
vec4 prepared_rows[HIDDEN]; // contribution of the biases and planes to the first layer

// width and height of the evaluated level in texels; the level may lie between two mip levels
vec2 level_size;
float level; // number of the evaluated level
// largest height, and difference between the largest and the smallest height
float level_top, level_range;

float height_at(vec2 p) {
    float byte = textureLod(heights, p / level_size, level).r;
    return level_top + level_range * (byte / 255.0 - 1.0);
}

void set_level(vec2 x) {
    vec2 size = vec2(textureSize(surface, 0).xy);
    level = 0.0;
#if N_LEVELS > 1 && !NEAREST
    // A level that is within a quarter of an integer is rounded to this integer. Most reads then
    // take only one mip level.
    float exact = mip_level(x, textureSize(surface, 0).xy, N_LEVELS), whole = floor(exact);
    level = whole + clamp(2.0 * (exact - whole) - 0.5, 0.0, 1.0);
#endif
    float shrunk = exp2(-level);
    level_size = max(size * shrunk, 1.0);
    level_range = 255.0 * height_scale.y * shrunk;
    level_top = height_scale.x * shrunk + level_range;
}

// A ray meets the reference plane at p. Returns the place where this ray ends (step 1).
vec2 ray_end_at(vec2 p) {
    vec2 w = vec2(prepared_v.x, -prepared_v.y) / max(prepared_v.z, 0.05);
    float n = clamp(ceil(4.0 * level_range * max(1.0, length(w))), 1.0, float(MAX_STEPS));
    float above = level_top, below = level_top;
    for (float k = 0.0; k <= n; k++) {
        above = below;
        below = level_top - level_range * k / n;
        if (height_at(p + w * below) >= below)
            break;
    }
    if (above > below)
        for (int k = 0; k < HALVINGS; k++) {
            float middle = 0.5 * (above + below);
            bool under = height_at(p + w * middle) >= middle;
            below = under ? middle : below;
            above = under ? above : middle;
        }
    return p + w * below;
}

// Returns shade, lit and clear at the end of a ray (step 2).
vec3 light_at(vec2 p, vec3 l) {
    const float e = 0.375;
    vec4 h = vec4(height_at(p + vec2(e, e)), height_at(p + vec2(e, -e)), height_at(p + vec2(-e, e)),
                  height_at(p - vec2(e, e)));
    vec3 n = normalize(vec3(-(h.x + h.y - h.z - h.w), h.x + h.z - h.y - h.w, 4.0 * e));
    float c = max(length(l.xy), 1e-4), r = l.z / c, z = height_at(p);
    vec2 d = vec2(l.x, -l.y) / c;
    float reach = level_range / max(r, 0.05) + 0.5, highest = r - 1.0, t = e;
    for (int k = 0; k < MAX_STEPS && t <= reach && level_top - z > highest * t; k++) {
        highest = max(highest, (height_at(p + d * t) - z) / t);
        t += max(0.25, t / 16.0);
    }
    float clear = clamp(r - highest, -1.0, 1.0), lit = clamp(0.5 + 10.0 * clear, 0.0, 1.0);
    return vec3(max(dot(n, l), 0.0) * lit, lit, clear);
}

// Returns S of step 5.
vec3 softened(vec3 y) {
    return max(y, 0.0) + log(1.0 + exp(-4.0 * abs(y))) * 0.25;
}

// Runs the network (steps 4 and 5) on the surface and the light.
vec3 network_at(vec4 channels[SURFACE_INPUTS], vec3 light) {
    vec4 a[HIDDEN], b[HIDDEN], o[2];
    for (int k = 0; k < HIDDEN; k++) {
        vec4 sum = prepared_rows[k] + first[k * INPUTS + INPUTS - 1] * vec4(light, 0.0);
        for (int i = 0; i < SURFACE_INPUTS; i++)
            sum += first[k * INPUTS + i] * channels[i];
        a[k] = max(sum, 0.01 * sum);
    }
    for (int k = 0; k < HIDDEN; k++) {
        vec4 sum = second_biases[k];
        for (int i = 0; i < HIDDEN; i++)
            sum += second[k * HIDDEN + i] * a[i];
        b[k] = max(sum, 0.01 * sum);
    }
    for (int k = 0; k < 2; k++) {
        o[k] = third_biases[k];
        for (int i = 0; i < HIDDEN; i++)
            o[k] += third[k * HIDDEN + i] * b[i];
    }
    return softened(o[0].rgb) * light.x + 0.3 * softened(o[1].rgb - 1.0);
}

// Returns the reflectance under an even sky at a place, interpolated between SKY × SKY views.
vec3 sky_at(vec2 x) {
    vec2 at = clamp(square(prepared_v) * float(SKY) - 0.5, 0.0, float(SKY) - 1.0);
    vec2 corner = min(floor(at), float(SKY) - 2.0), part = at - corner;
    vec3 sum = vec3(0.0);
    for (int k = 0; k < 4; k++) {
        vec2 one = vec2(k & 1, k >> 1), near = mix(1.0 - part, part, one);
        vec2 cell = corner + one;
        vec2 size = vec2(textureSize(skies, 0).xy), whole = vec2(textureSize(surface, 0).xy);
        float coarse = max(level - log2(whole.x / size.x), 0.0);
        sum +=
            near.x * near.y * textureLod(skies, vec3(x, cell.y * float(SKY) + cell.x), coarse).rgb;
    }
    return sum;
}

// See method.h. The planes are the same for all texels (step 3).
void btf_prepare(vec3 v, vec3 l, float lit) {
    prepared_v = v;
    prepared_l = l;
    prepared_lit = lit * step(0.0, l.z);
    vec3 g = (v + l) / max(length(v + l), 1e-6);
    vec2 f = l.xy - g.xy * (dot(l.xy, g.xy) / (1.0 + g.z) + l.z);
    vec4 inputs[4];
    for (int k = 0; k < 4; k++)
        inputs[k] = textureLod(planes, vec3(0.5 * (k < 2 ? g.xy : f) + 0.5, float(k)), 0.0);
    for (int k = 0; k < HIDDEN; k++) {
        prepared_rows[k] = first_biases[k];
        for (int i = 0; i < 4; i++)
            prepared_rows[k] += first[k * INPUTS + SURFACE_INPUTS + i] * inputs[i];
    }
}

vec3 btf_texel(vec2 x) {
    set_level(x);
    vec2 p = x * level_size, middle = vec2(0.0);
#if NEAREST
    p = floor(p) + 0.5;
#endif
    vec4 channels[SURFACE_INPUTS];
    vec3 light = vec3(0.0);
    for (int i = 0; i < SURFACE_INPUTS; i++)
        channels[i] = vec4(0.0);
    for (int ray = 0; ray < N_RAYS; ray++) {
        vec2 apart = N_RAYS == 1 ? vec2(0.0) : vec2(ray & 1, ray >> 1) * 0.5 - 0.25;
        vec2 end = ray_end_at(p + apart);
        middle += end / float(N_RAYS);
        if (prepared_lit > 0.0) {
            light += light_at(end, prepared_l) / float(N_RAYS);
            for (int i = 0; i < SURFACE_INPUTS; i++)
                channels[i] +=
                    textureLod(surface, vec3(end / level_size, float(i)), level) / float(N_RAYS);
        }
    }
    vec3 sum = vec3(0.0);
    if (prepared_lit > 0.0)
        sum = prepared_lit * network_at(channels, light);
#if AMBIENT
    sum += ambient * sky_at(middle / level_size);
#endif
    return sum;
}

vec3 btf(vec2 x, vec3 v, vec3 l, float lit) {
    btf_prepare(v, l, lit);
    return btf_texel(x);
}
