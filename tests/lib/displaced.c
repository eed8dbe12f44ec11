#include "displaced.h"

#include <embree3/rtcore.h>
#include <math.h>
#include <string.h>

#define RAD (G_PI / 180)

struct Displaced {
    struct displaced_shape shape;
    RTCDevice device;
    RTCScene solid, tile, scene; /* scene contains instances of solid (the shape) and of tile */
    float *albedo;               /* for each vertex of a tile */
    guint n_vertices;            /* of a tile */
    guint32 *triangles;          /* of a tile */
    guint n_triangles;
};

struct tile {
    float *mm, *albedo; /* n × 3: x and y from the tile's middle, z from the reference plane */
    guint n_vertices;
    GArray *triangles;
};

/* Cuts out the triangles whose middle lies on the tile, with their vertices. */
static void cut(const struct truth_surface *s, const struct displaced_shape *shape,
                struct tile *ret) {
    g_autofree guint32 *number = g_new(guint32, s->n_vertices);
    memset(number, 0xff, sizeof(guint32) * s->n_vertices);
    *ret = (struct tile){.triangles = g_array_new(FALSE, FALSE, sizeof(guint32))};
    ret->mm = g_new(float, 3 * (gsize)s->n_vertices);
    ret->albedo = g_new(float, 3 * (gsize)s->n_vertices);
    for (guint k = 0; k < s->n_triangles; k++) {
        double middle[2] = {0, 0};
        const guint32 *corners = s->triangles + 3 * (gsize)k;
        for (int c = 0; c < 3; c++)
            for (int axis = 0; axis < 2; axis++)
                middle[axis] += s->vertices[(gsize)s->stride * corners[c] + axis] / 3.0;
        if (fabs(middle[0]) > shape->tile_mm / 2 || fabs(middle[1]) > shape->tile_mm / 2)
            continue;
        for (int c = 0; c < 3; c++) {
            guint32 *at = &number[corners[c]];
            const float *vertex = s->vertices + (gsize)s->stride * corners[c];
            if (*at == G_MAXUINT32) {
                *at = ret->n_vertices++;
                memcpy(ret->mm + 3 * (gsize)*at, vertex, 3 * sizeof(float));
                memcpy(ret->albedo + 3 * (gsize)*at, vertex + s->albedo, 3 * sizeof(float));
                ret->mm[3 * (gsize)*at + 2] -= shape->reference_mm;
            }
            g_array_append_val(ret->triangles, *at);
        }
    }
}

static void on_torus(const struct displaced_shape *s, const float mm[3], int i, int j,
                     float ret[3]) {
    double a = 2 * G_PI * (mm[0] / s->tile_mm + 0.5 + i) / s->tiles_u;
    double b = 2 * G_PI * (mm[1] / s->tile_mm + 0.5 + j) / s->tiles_v;
    double around = 2 * G_PI * (s->radius + s->tube_radius * cos(b)) / s->tiles_u / s->tile_mm;
    double along = 2 * G_PI * s->tube_radius / s->tiles_v / s->tile_mm;
    double r = s->tube_radius + mm[2] * sqrt(around * along);
    ret[0] = (s->radius + r * cos(b)) * cos(a);
    ret[1] = (s->radius + r * cos(b)) * sin(a);
    ret[2] = r * sin(b);
}

static void on_cylinder(const struct displaced_shape *s, const float mm[3], int i, int j,
                        float ret[3]) {
    double a = 2 * G_PI * (mm[0] / s->tile_mm + 0.5 + i) / s->tiles_u;
    double around = 2 * G_PI * s->radius / s->tiles_u / s->tile_mm;
    double along = s->height / s->tiles_v / s->tile_mm,
           r = s->radius + mm[2] * sqrt(around * along);
    ret[0] = r * cos(a);
    ret[1] = r * sin(a);
    ret[2] = s->height * ((mm[1] / s->tile_mm + 0.5 + j) / s->tiles_v - 0.5);
}

/* Places a point on the upper end (side = 1) or the lower end (side = −1). Returns FALSE if it is
 * beyond the edge of the end. */
static gboolean on_end(const struct displaced_shape *s, const float mm[3], int i, int j,
                       double side, float ret[3]) {
    double along = s->height / s->tiles_v / s->tile_mm;
    double around = 2 * G_PI * s->radius / s->tiles_u / s->tile_mm;
    ret[0] = around * (mm[0] + s->tile_mm * (0.5 + i));
    ret[1] = side * along * (mm[1] + s->tile_mm * (0.5 + j));
    ret[2] = side * (s->height / 2 + mm[2] * sqrt(around * along));
    return hypot(ret[0], ret[1]) <= s->radius;
}

static RTCGeometry new_triangles(Displaced *d, guint n_vertices, guint n_triangles,
                                 float **ret_vertices, guint32 **ret_triangles) {
    RTCGeometry geometry = rtcNewGeometry(d->device, RTC_GEOMETRY_TYPE_TRIANGLE);
    *ret_vertices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                            3 * sizeof(float), n_vertices);
    *ret_triangles = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                             3 * sizeof(guint32), n_triangles);
    return geometry;
}

static void attach(RTCScene scene, RTCGeometry geometry) {
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);
    rtcReleaseGeometry(geometry);
}

static void add_instance(Displaced *d, RTCScene of, double x, double y, double z) {
    float to[12] = {1, 0, 0, 0, 1, 0, 0, 0, 1, (float)x, (float)y, (float)z};
    RTCGeometry instance = rtcNewGeometry(d->device, RTC_GEOMETRY_TYPE_INSTANCE);
    rtcSetGeometryInstancedScene(instance, of);
    rtcSetGeometryTransform(instance, 0, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, to);
    attach(d->scene, instance);
}

static void attach_solid(Displaced *d, RTCGeometry geometry) {
    d->solid = rtcNewScene(d->device);
    rtcSetSceneFlags(d->solid, RTC_SCENE_FLAG_ROBUST | RTC_SCENE_FLAG_COMPACT);
    attach(d->solid, geometry);
}

static void add_sides(Displaced *d, const struct tile *tile) {
    guint copies = d->shape.tiles_u * d->shape.tiles_v;
    float *vertices;
    guint32 *triangles;
    RTCGeometry geometry =
        new_triangles(d, copies * tile->n_vertices, copies * d->n_triangles, &vertices, &triangles);
    for (guint copy = 0; copy < copies; copy++) {
        for (guint k = 0; k < tile->n_vertices; k++, vertices += 3)
            (d->shape.height > 0 ? on_cylinder : on_torus)(&d->shape, tile->mm + 3 * (gsize)k,
                                                           copy % d->shape.tiles_u,
                                                           copy / d->shape.tiles_u, vertices);
        for (guint k = 0; k < 3 * d->n_triangles; k++)
            *triangles++ = d->triangles[k] + copy * tile->n_vertices;
    }
    attach_solid(d, geometry);
}

/* Adds all tiles of which a corner may lie on an end. A triangle with a corner beyond the edge is
 * reduced to a point, so that the numbers of triangles do not change. */
static void add_end(Displaced *d, const struct tile *tile, double side) {
    const struct displaced_shape *s = &d->shape;
    int n_u = (int)ceil(s->tiles_u / (2 * G_PI)),
        n_v = (int)ceil(s->radius / s->height * s->tiles_v);
    guint copies = 4 * n_u * n_v, n = tile->n_vertices;
    float *vertices;
    guint32 *triangles;
    RTCGeometry geometry =
        new_triangles(d, copies * n, copies * d->n_triangles, &vertices, &triangles);
    g_autofree gboolean *inside = g_new(gboolean, n);
    for (guint copy = 0; copy < copies; copy++) {
        int i = (int)copy % (2 * n_u) - n_u, j = (int)copy / (2 * n_u) - n_v;
        for (guint k = 0; k < n; k++, vertices += 3)
            inside[k] = on_end(s, tile->mm + 3 * (gsize)k, i, j, side, vertices);
        for (guint k = 0; k < d->n_triangles; k++) {
            const guint32 *of = d->triangles + 3 * (gsize)k;
            gboolean all = inside[of[0]] && inside[of[1]] && inside[of[2]];
            for (int c = 0; c < 3; c++)
                *triangles++ = of[all ? c : 0] + copy * n;
        }
    }
    attach(d->solid, geometry);
}

static void add_solid(Displaced *d, const struct tile *tile) {
    add_sides(d, tile);
    for (int side = -1; side <= 1 && d->shape.height > 0; side += 2)
        add_end(d, tile, side);
    rtcCommitScene(d->solid);
    add_instance(d, d->solid, 0, 0, 0);
}

static void add_floor(Displaced *d, const struct tile *tile) {
    float *vertices;
    guint32 *triangles;
    const struct displaced_shape *s = &d->shape;
    double along = s->height > 0 ? s->height : 2 * G_PI * s->tube_radius;
    double area = 2 * G_PI * s->radius / s->tiles_u * along / s->tiles_v;
    double scale = sqrt(area) / s->tile_mm, width = scale * s->tile_mm;
    double below = s->height > 0 ? s->height / 2 : s->tube_radius;
    d->tile = rtcNewScene(d->device);
    RTCGeometry geometry =
        new_triangles(d, tile->n_vertices, d->n_triangles, &vertices, &triangles);
    for (gsize k = 0; k < 3 * (gsize)tile->n_vertices; k++)
        vertices[k] = scale * tile->mm[k];
    memcpy(triangles, d->triangles, 3 * sizeof(guint32) * (gsize)d->n_triangles);
    attach(d->tile, geometry);
    rtcCommitScene(d->tile);
    int n = (int)ceil(d->shape.floor / width);
    for (int j = -n; j < n; j++)
        for (int i = -n; i < n; i++)
            add_instance(d, d->tile, (i + 0.5) * width, (j + 0.5) * width, -below);
}

Displaced *displaced_new(const struct truth_surface *surface, const struct displaced_shape *shape) {
    struct tile tile;
    Displaced *d = g_new0(Displaced, 1);
    d->shape = *shape;
    d->device = rtcNewDevice("threads=2");
    d->scene = rtcNewScene(d->device);
    rtcSetSceneFlags(d->scene, RTC_SCENE_FLAG_ROBUST);
    cut(surface, shape, &tile);
    d->n_vertices = tile.n_vertices;
    d->n_triangles = tile.triangles->len / 3;
    d->triangles = (guint32 *)g_array_free(tile.triangles, FALSE);
    d->albedo = tile.albedo;
    add_solid(d, &tile);
    if (shape->floor > 0)
        add_floor(d, &tile);
    rtcCommitScene(d->scene);
    g_free(tile.mm);
    return d;
}

void displaced_free(Displaced *d) {
    if (!d)
        return;
    rtcReleaseScene(d->scene);
    rtcReleaseScene(d->solid);
    if (d->tile)
        rtcReleaseScene(d->tile);
    rtcReleaseDevice(d->device);
    g_free(d->albedo);
    g_free(d->triangles);
    g_free(d);
}

static double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void set_ray(struct RTCRay *ray, const double from[3], const double d[3], double near) {
    *ray = (struct RTCRay){.org_x = from[0],
                           .org_y = from[1],
                           .org_z = from[2],
                           .tnear = near,
                           .dir_x = d[0],
                           .dir_y = d[1],
                           .dir_z = d[2],
                           .tfar = INFINITY,
                           .mask = G_MAXUINT32};
}

static gboolean blocked(RTCScene scene, const double p[3], const double light[3]) {
    struct RTCIntersectContext context;
    struct RTCRay ray;
    rtcInitIntersectContext(&context);
    set_ray(&ray, p, light, 1e-4);
    rtcOccluded1(scene, &context, &ray);
    return ray.tfar < 0;
}

static void shade(Displaced *d, const struct RTCRayHit *hit, const double light[3],
                  struct displaced_pixel *ret) {
    double t = hit->ray.tfar, n[3] = {hit->hit.Ng_x, hit->hit.Ng_y, hit->hit.Ng_z};
    double p[3] = {hit->ray.org_x + t * hit->ray.dir_x, hit->ray.org_y + t * hit->ray.dir_y,
                   hit->ray.org_z + t * hit->ray.dir_z};
    const guint32 *corners = d->triangles + 3 * (gsize)(hit->hit.primID % d->n_triangles);
    ret->part = hit->hit.instID[0] == 0 ? DISPLACED_SHAPE : DISPLACED_FLOOR;
    ret->distance = t;
    ret->cosine = MAX(dot(n, light) / sqrt(dot(n, n)), 0.0);
    ret->dark = ret->cosine <= 0 || blocked(d->scene, p, light);
    ret->shadowed = ret->part == DISPLACED_FLOOR && blocked(d->solid, p, light);
    for (int c = 0; c < 3; c++)
        ret->albedo[c] = d->albedo[3 * (gsize)corners[0] + c] * (1 - hit->hit.u - hit->hit.v) +
                         d->albedo[3 * (gsize)corners[1] + c] * hit->hit.u +
                         d->albedo[3 * (gsize)corners[2] + c] * hit->hit.v;
}

void displaced_trace(Displaced *d, const struct displaced_camera *c, const double light[3],
                     struct displaced_pixel *ret) {
    double half = tan(c->fov_deg * RAD / 2) / MIN(c->width, c->height), eye[3];
    double e = c->elevation_deg * RAD, a = c->azimuth_deg * RAD;
    const double back[3] = {cos(e) * cos(a), cos(e) * sin(a), sin(e)}; /* towards the eye */
    const double right[3] = {-sin(a), cos(a), 0};
    const double up[3] = {-sin(e) * cos(a), -sin(e) * sin(a), cos(e)};
    for (int k = 0; k < 3; k++)
        eye[k] = c->distance * back[k] + c->right * right[k] + c->up * up[k];
    for (int j = 0; j < c->height; j++)
        for (int i = 0; i < c->width; i++, ret++) {
            struct RTCIntersectContext context;
            struct RTCRayHit hit = {.hit.geomID = RTC_INVALID_GEOMETRY_ID};
            double x = (2 * i + 1 - c->width) * half, y = (c->height - 2 * j - 1) * half, ray[3];
            double length = sqrt(1 + x * x + y * y);
            for (int k = 0; k < 3; k++)
                ray[k] = (x * right[k] + y * up[k] - back[k]) / length;
            hit.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
            set_ray(&hit.ray, eye, ray, 0);
            rtcInitIntersectContext(&context);
            rtcIntersect1(d->scene, &context, &hit);
            *ret = (struct displaced_pixel){.part = DISPLACED_NONE};
            if (hit.hit.geomID != RTC_INVALID_GEOMETRY_ID)
                shade(d, &hit, light, ret);
        }
}
