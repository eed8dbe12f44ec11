#include "world_private.h"

/* Packs a unit vector as a point of the octahedron |x| + |y| + |z| = 1. The lower half of the
 * octahedron is folded outwards, so that it surrounds the upper half. */
static void pack_direction(const float d[3], gint16 ret[2]) {
    float size = fabsf(d[0]) + fabsf(d[1]) + fabsf(d[2]), x = d[0] / size, y = d[1] / size;
    if (d[2] < 0) {
        float kept = x;
        x = copysignf(1 - fabsf(y), x);
        y = copysignf(1 - fabsf(kept), y);
    }
    ret[0] = (gint16)lrintf(x * G_MAXINT16);
    ret[1] = (gint16)lrintf(y * G_MAXINT16);
}

static inline void unpack_direction(const gint16 from[2], float ret[3]) {
    float x = from[0] * (1.0f / G_MAXINT16), y = from[1] * (1.0f / G_MAXINT16);
    float z = 1 - fabsf(x) - fabsf(y), fold = MAX(-z, 0);
    x -= copysignf(fold, x);
    y -= copysignf(fold, y);
    float scale = 1 / sqrtf(x * x + y * y + z * z);
    ret[0] = x * scale;
    ret[1] = y * scale;
    ret[2] = z * scale;
}

static guint16 pack_share(float share) {
    return (guint16)lrintf(CLAMP(share, 0, 1) * G_MAXUINT16);
}

void world_pack(const struct surface *from, enum cfa_colour colour, guint32 pixel,
                struct point *ret) {
    *ret = (struct point){
        .p = {from->p[0], from->p[1], from->p[2]},
        .albedo = pack_share(from->albedo[colour]),
        .gloss = pack_share(from->gloss),
        /* The roughness of the gloss is a divisor, so it must not be rounded to 0. */
        .along = MAX(pack_share(from->along), 1),
        .across = MAX(pack_share(from->across), 1),
        .u = pack_share(from->u),
        .v = pack_share(from->v),
        .triangle = from->triangle,
        .pixel = pixel,
    };
    pack_direction(from->n, ret->n);
    pack_direction(from->t, ret->t);
    pack_direction(from->ng, ret->ng);
}

void world_unpack(const struct point *from, struct surface *ret) {
    const float unit = 1.0f / G_MAXUINT16;
    for (int k = 0; k < 3; k++) {
        ret->p[k] = from->p[k];
        ret->albedo[k] = from->albedo * unit;
    }
    unpack_direction(from->n, ret->n);
    unpack_direction(from->t, ret->t);
    unpack_direction(from->ng, ret->ng);
    ret->gloss = from->gloss * unit;
    ret->along = from->along * unit;
    ret->across = from->across * unit;
    ret->u = from->u * unit;
    ret->v = from->v * unit;
    ret->triangle = from->triangle;
}

int world_light_points(const World *world, const struct view *view, guint first, struct v3 light_mm,
                       struct surface *ret, guint8 *ret_blocked) {
    int n = (int)MIN(SCENE_BATCH, view->n - first);
    for (int i = 0; i < n; i++)
        world_unpack(&view->points[first + (guint)i], &ret[i]);
    scene_shadow(&world->scene, light_mm, ret, n, ret_blocked);
    return n;
}
