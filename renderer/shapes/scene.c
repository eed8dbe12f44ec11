#include "scene.h"

#include <math.h>
#include <string.h>

#define FLOOR 4.0 /* half the width of the floor, in radii of the mesh */

G_DEFINE_QUARK(scene_error, scene_error)

struct grid_shape {
    double radius, tube_radius, height;
};

/* Fills position, normal and tangent from uv in [0, 1]². */
typedef void (*GridPoint)(const struct grid_shape *shape, double u, double v, struct vertex *ret);

static void set3(float ret[3], double x, double y, double z) {
    ret[0] = x;
    ret[1] = y;
    ret[2] = z;
}

static void scene_plane_point(const struct grid_shape *shape, double u, double v,
                              struct vertex *ret) {
    set3(ret->position, 2.0 * u - 1.0, 2.0 * v - 1.0, 0.0);
    set3(ret->normal, 0.0, 0.0, 1.0);
    set3(ret->tangent, 1.0, 0.0, 0.0);
}

static void torus_point(const struct grid_shape *shape, double u, double v, struct vertex *ret) {
    double a = 2.0 * G_PI * u, b = 2.0 * G_PI * v;
    double r = shape->radius + shape->tube_radius * cos(b);
    set3(ret->position, r * cos(a), r * sin(a), shape->tube_radius * sin(b));
    set3(ret->normal, cos(b) * cos(a), cos(b) * sin(a), sin(b));
    set3(ret->tangent, -sin(a), cos(a), 0.0);
}

static void sphere_point(const struct grid_shape *shape, double u, double v, struct vertex *ret) {
    double a = 2.0 * G_PI * u, b = G_PI * (v - 0.5);
    set3(ret->normal, cos(b) * cos(a), cos(b) * sin(a), sin(b));
    memcpy(ret->position, ret->normal, sizeof ret->position);
    set3(ret->tangent, -sin(a), cos(a), 0.0);
}

static void cylinder_point(const struct grid_shape *shape, double u, double v, struct vertex *ret) {
    double a = 2.0 * G_PI * u;
    set3(ret->position, shape->radius * cos(a), shape->radius * sin(a), shape->height * (v - 0.5));
    set3(ret->normal, cos(a), sin(a), 0.0);
    set3(ret->tangent, -sin(a), cos(a), 0.0);
}

/* Computes a point of the (2, 3) torus knot at parameter t. */
static void knot_curve(double t, double ret[3]) {
    double r = 2.0 + cos(3.0 * t);
    ret[0] = r * cos(2.0 * t);
    ret[1] = r * sin(2.0 * t);
    ret[2] = sin(3.0 * t);
}

/* Computes a point of the knot and its normal. u is the position along the centre line of the tube,
 * and b the angle around the tube, from its upper side. The directions around the tube are
 * perpendicular to the centre line, which is nowhere vertical. */
static void knot_at(const struct grid_shape *shape, double u, double v, double ret[3],
                    double ret_normal[3]) {
    double t = 2.0 * G_PI * u, b = 2.0 * G_PI * v, middle[3], along[3], aside[3];
    double out[3] = {0.0, 0.0, 1.0};
    knot_curve(t, middle);
    knot_curve(t - 1e-4, aside);
    knot_curve(t + 1e-4, along);
    for (int k = 0; k < 3; k++)
        along[k] -= aside[k];
    double length = sqrt(along[0] * along[0] + along[1] * along[1] + along[2] * along[2]);
    for (int k = 0; k < 3; k++)
        along[k] /= length;
    double off = along[2];
    length = 0.0;
    for (int k = 0; k < 3; k++) {
        out[k] -= off * along[k];
        length = hypot(length, out[k]);
    }
    for (int k = 0; k < 3; k++)
        out[k] /= length;
    for (int k = 0; k < 3; k++)
        aside[k] = out[(k + 1) % 3] * along[(k + 2) % 3] - out[(k + 2) % 3] * along[(k + 1) % 3];
    for (int k = 0; k < 3; k++) {
        ret_normal[k] = cos(b) * out[k] + sin(b) * aside[k];
        ret[k] = shape->radius * middle[k] + shape->tube_radius * ret_normal[k];
    }
}

static void knot_point(const struct grid_shape *shape, double u, double v, struct vertex *ret) {
    double p[3], n[3], before[3], after[3], unused[3], t[3], length = 0.0;
    knot_at(shape, u, v, p, n);
    knot_at(shape, u - 1e-4, v, before, unused);
    knot_at(shape, u + 1e-4, v, after, unused);
    for (int k = 0; k < 3; k++)
        t[k] = after[k] - before[k];
    double off = t[0] * n[0] + t[1] * n[1] + t[2] * n[2];
    for (int k = 0; k < 3; k++)
        length = hypot(length, t[k] -= off * n[k]);
    set3(ret->position, p[0], p[1], p[2]);
    set3(ret->normal, n[0], n[1], n[2]);
    set3(ret->tangent, t[0] / length, t[1] / length, t[2] / length);
}

static struct mesh *grid(const char *name, const struct grid_shape *shape, GridPoint fill, int nu,
                         int nv, double tiles_u, double tiles_v) {
    struct mesh *mesh = g_new0(struct mesh, 1);
    mesh->name = g_strdup(name);
    mesh->tiles_u = tiles_u;
    mesh->tiles_v = tiles_v;
    mesh->n_vertices = (nu + 1) * (nv + 1);
    mesh->vertices = g_new0(struct vertex, mesh->n_vertices);
    mesh->n_indices = 6 * nu * nv;
    mesh->indices = g_new(guint32, mesh->n_indices);
    for (int j = 0; j <= nv; j++)
        for (int i = 0; i <= nu; i++) {
            struct vertex *vertex = &mesh->vertices[j * (nu + 1) + i];
            double u = (double)i / nu, v = (double)j / nv;
            fill(shape, u, v, vertex);
            vertex->tangent[3] = 1.0f;
            vertex->uv[0] = u;
            vertex->uv[1] = v;
            float *p = vertex->position;
            mesh->radius = MAX(mesh->radius, sqrtf(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]));
        }
    guint32 *out = mesh->indices;
    for (int j = 0; j < nv; j++)
        for (int i = 0; i < nu; i++, out += 6) {
            guint32 a = (guint32)j * (nu + 1) + i, b = a + 1, c = a + nu + 1, d = c + 1;
            memcpy(out, (const guint32[6]){a, b, d, a, d, c}, 6 * sizeof *out);
        }
    return mesh;
}

struct mesh *scene_plane(void) {
    return grid("plane", NULL, scene_plane_point, 1, 1, 2, 2);
}

struct mesh *scene_torus(double radius, double tube_radius, int n_around, int n_tube) {
    struct grid_shape shape = {.radius = radius, .tube_radius = tube_radius};
    double around = 8.0, tube = MAX(1.0, round(around * tube_radius / radius));
    return grid("torus", &shape, torus_point, n_around, n_tube, around, tube);
}

struct mesh *scene_sphere(void) {
    return grid("sphere", NULL, sphere_point, 128, 64, 6, 3);
}

/* Adds a flat end to a cylinder, facing up (side 1) or down (side −1). The texels of the end have
 * about the same size as those of the side. */
static void add_lid(struct mesh *mesh, const struct grid_shape *shape, int n, double side) {
    guint first = mesh->n_vertices, at = mesh->n_indices;
    mesh->vertices = g_renew(struct vertex, mesh->vertices, mesh->n_vertices += n + 1);
    mesh->indices = g_renew(guint32, mesh->indices, mesh->n_indices += 3 * n);
    for (int k = 0; k <= n; k++) {
        double r = k == n ? 0.0 : shape->radius, a = 2.0 * G_PI * k / n;
        struct vertex *v = &mesh->vertices[first + k];
        *v = (struct vertex){.normal = {0, 0, side}, .tangent = {1, 0, 0, 1}};
        set3(v->position, r * cos(a), r * sin(a), 0.5 * side * shape->height);
        v->uv[0] = v->position[0] / (2.0 * G_PI * shape->radius);
        v->uv[1] = side * v->position[1] / shape->height;
    }
    for (int k = 0; k < n; k++) {
        guint32 a = first + k, b = first + (k + 1) % n;
        guint32 triangle[3] = {first + n, side > 0.0 ? a : b, side > 0.0 ? b : a};
        memcpy(mesh->indices + at + 3 * (gsize)k, triangle, sizeof triangle);
    }
}

/* Makes a cylinder around z, with flat ends. */
static struct mesh *scene_cylinder(void) {
    struct grid_shape shape = {.radius = 0.6, .height = 1.6};
    struct mesh *mesh = grid("cylinder", &shape, cylinder_point, 128, 1, 5, 2);
    add_lid(mesh, &shape, 128, 1.0);
    add_lid(mesh, &shape, 128, -1.0);
    return mesh;
}

/* Makes a (2, 3) torus knot around z. u increases along the tube, v around it. */
static struct mesh *scene_torus_knot(void) {
    struct grid_shape shape = {.radius = 0.42, .tube_radius = 0.18};
    return grid("torus-knot", &shape, knot_point, 768, 48, 24, 2);
}

static void scene_minus(const float *a, const float *b, int n, double ret[3]) {
    for (int k = 0; k < 3; k++)
        ret[k] = k < n ? a[k] - b[k] : 0.0;
}

static double twice_area(const double a[3], const double b[3]) {
    return sqrt(pow(a[1] * b[2] - a[2] * b[1], 2) + pow(a[2] * b[0] - a[0] * b[2], 2) +
                pow(a[0] * b[1] - a[1] * b[0], 2));
}

/* Adds a square floor at the height of the lowest point of the mesh. half_width is half the width
 * of the floor, in radii of the mesh. The tiles of the floor are square. They have the mean size of
 * the mesh's tiles if the mesh has tiles_u × tiles_v tiles. */
static void scene_add_floor(struct mesh *mesh, double half_width) {
    static const guint32 corners[6] = {0, 1, 3, 0, 3, 2};
    double area = 0.0, flat = 0.0, e1[3], e2[3]; /* sums of areas on the mesh, and in u and v */
    for (guint k = 0; k + 2 < mesh->n_indices; k += 3) {
        const struct vertex *v[3];
        for (int c = 0; c < 3; c++)
            v[c] = &mesh->vertices[mesh->indices[k + c]];
        scene_minus(v[1]->position, v[0]->position, 3, e1);
        scene_minus(v[2]->position, v[0]->position, 3, e2);
        area += twice_area(e1, e2);
        scene_minus(v[1]->uv, v[0]->uv, 2, e1);
        scene_minus(v[2]->uv, v[0]->uv, 2, e2);
        flat += twice_area(e1, e2);
    }
    double scale = flat > 0.0 && area > 0.0 ? area / flat : 1.0;
    double tile = sqrt(scale / (mesh->tiles_u * mesh->tiles_v));
    double half = half_width * mesh->radius;
    float low = 0.0f;
    for (guint k = 0; k < mesh->n_vertices; k++)
        low = MIN(low, mesh->vertices[k].position[2]);
    guint first = mesh->n_vertices, at = mesh->n_indices;
    mesh->vertices = g_renew(struct vertex, mesh->vertices, mesh->n_vertices += 4);
    mesh->indices = g_renew(guint32, mesh->indices, mesh->n_indices += 6);
    mesh->n_floor_vertices = 4;
    mesh->n_floor_indices = 6;
    for (int k = 0; k < 4; k++) {
        struct vertex *v = &mesh->vertices[first + k];
        double x = k & 1 ? half : -half, y = k & 2 ? half : -half;
        *v = (struct vertex){.normal = {0, 0, 1}, .tangent = {1, 0, 0, 1}};
        set3(v->position, x, y, low);
        /* Renderers multiply the coordinates of the floor, too, by tiles_u and tiles_v. */
        v->uv[0] = x / tile / mesh->tiles_u;
        v->uv[1] = y / tile / mesh->tiles_v;
    }
    for (int k = 0; k < 6; k++)
        mesh->indices[at + k] = first + corners[k];
}

void mesh_free(struct mesh *mesh) {
    if (mesh == NULL)
        return;
    g_free(mesh->name);
    g_free(mesh->vertices);
    g_free(mesh->indices);
    g_free(mesh->parts);
    g_free(mesh);
}

static struct mesh *default_torus(void) {
    return scene_torus(1.0, 0.4, 192, 96);
}

const char *const scene_shape_names[SCENE_SHAPES] = {"plane", "torus", "sphere", "cylinder",
                                                     "torus-knot"};

struct mesh *scene_shape(const char *name, enum scene_up up, GError **error) {
    static struct mesh *(*const makers[SCENE_SHAPES])(void) = {
        scene_plane, default_torus, scene_sphere, scene_cylinder, scene_torus_knot};
    g_autofree char *lower = g_ascii_strdown(name, -1);
    for (int k = 0; k < SCENE_SHAPES; k++)
        if (strcmp(name, scene_shape_names[k]) == 0)
            return makers[k]();
    if (g_str_has_suffix(lower, ".obj"))
        return scene_read_obj(name, up, error);
    if (g_str_has_suffix(lower, ".gltf") || g_str_has_suffix(lower, ".glb"))
        return scene_read_gltf(name, up, error);
    g_set_error(error, SCENE_ERROR, SCENE_ERROR_NO_SHAPE,
                "“%s” is not a shape; give plane, torus, sphere, cylinder, torus-knot or the path "
                "of an .obj, .gltf or .glb file",
                name);
    return NULL;
}

struct mesh *scene_make(const char *name, const struct scene_options *options, GError **error) {
    struct mesh *mesh = scene_shape(name, options->up, error);
    if (mesh == NULL)
        return NULL;
    if (options->tiles_u > 0.0 && options->tiles_v > 0.0) {
        mesh->tiles_u = options->tiles_u;
        mesh->tiles_v = options->tiles_v;
    }
    if (options->floor)
        scene_add_floor(mesh, FLOOR);
    return mesh;
}
