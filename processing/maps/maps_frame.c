/* The lobes of a shape. The loop runs over all pairs in planes of floats, so that compilers can
 * vectorise it. */
#include "maps_fit_private.h"

#include <math.h>

#define MIN_COSINE 1e-3F

struct maps_frame maps_frame_of(const float shape[MAPS_SHAPE]) {
    struct maps_frame ret;
    const float length = hypotf(shape[0], shape[1]);
    const float shrink = length > MAPS_MAX_NORMAL ? MAPS_MAX_NORMAL / length : 1;
    const float nx = shape[0] * shrink, ny = shape[1] * shrink;
    const float spread = hypotf(shape[3], shape[4]), angle = 0.5F * atan2f(shape[4], shape[3]);
    const float dx = cosf(angle), dy = sinf(angle), along = dx * nx + dy * ny;
    const float nz = sqrtf(1 - nx * nx - ny * ny);
    float t[3] = {dx - along * nx, dy - along * ny, -along * nz};
    const float size = sqrtf(t[0] * t[0] + t[1] * t[1] + t[2] * t[2]);
    ret.at = expf(CLAMP(shape[2] + spread, MAPS_MIN_LOG_ALPHA, 0));
    ret.ab = expf(CLAMP(shape[2] - spread, MAPS_MIN_LOG_ALPHA, 0));
    ret.direction[0] = dx;
    ret.direction[1] = dy;
    ret.n[0] = nx;
    ret.n[1] = ny;
    ret.n[2] = nz;
    for (int i = 0; i < 3; i++)
        ret.t[i] = t[i] / size;
    ret.b[0] = ny * ret.t[2] - nz * ret.t[1];
    ret.b[1] = nz * ret.t[0] - nx * ret.t[2];
    ret.b[2] = nx * ret.t[1] - ny * ret.t[0];
    return ret;
}

void maps_frame_lobes(const struct maps_frame *frame, const struct maps_pairs *pairs,
                      float *restrict diffuse, float *restrict lobe) {
    const float *const *p = (const float *const *)pairs->planes;
    const struct maps_frame f = *frame;
    const float inverse_t = 1 / f.at, inverse_b = 1 / f.ab, scale = 0.5F / (f.at * f.ab);
    for (int i = 0; i < pairs->n; i++) {
        const float vx = p[MAPS_VX][i], vy = p[MAPS_VY][i], vz = p[MAPS_VZ][i];
        const float lx = p[MAPS_LX][i], ly = p[MAPS_LY][i], lz = p[MAPS_LZ][i];
        const float hx = p[MAPS_HX][i], hy = p[MAPS_HY][i], hz = p[MAPS_HZ][i];
        const float nl = f.n[0] * lx + f.n[1] * ly + f.n[2] * lz;
        const float nv = f.n[0] * vx + f.n[1] * vy + f.n[2] * vz;
        const float nh = f.n[0] * hx + f.n[1] * hy + f.n[2] * hz;
        const float th = (f.t[0] * hx + f.t[1] * hy + f.t[2] * hz) * inverse_t;
        const float bh = (f.b[0] * hx + f.b[1] * hy + f.b[2] * hz) * inverse_b;
        const float tv = (f.t[0] * vx + f.t[1] * vy + f.t[2] * vz) * f.at;
        const float bv = (f.b[0] * vx + f.b[1] * vy + f.b[2] * vz) * f.ab;
        const float tl = (f.t[0] * lx + f.t[1] * ly + f.t[2] * lz) * f.at;
        const float bl = (f.b[0] * lx + f.b[1] * ly + f.b[2] * lz) * f.ab;
        const float w = th * th + bh * bh + nh * nh;
        const float cl = nl > MIN_COSINE ? nl : MIN_COSINE;
        const float cv = nv > MIN_COSINE ? nv : MIN_COSINE;
        const float both =
            cl * sqrtf(tv * tv + bv * bv + cv * cv) + cv * sqrtf(tl * tl + bl * bl + cl * cl);
        const float lit = nl > MIN_COSINE && nv > MIN_COSINE ? cl : 0;
        diffuse[i] = lit;
        lobe[i] = lit * scale / (w * w * both);
    }
}
