#include "sample.h"

#include <math.h>
#include <string.h>

static const char *const kinds[] = {"flat",     "weave", "brushed", "brick", "peanuts", "ridges",
                                    "picture",  "obj",   "poles",   "balls", "plate",   "grass",
                                    "bluepipe", "block", "mail",    NULL};

#define AT(field) G_STRUCT_OFFSET(struct sample_options, field)
const struct option sample_option_table[] = {
    {"kind", OPTION_CHOICE, NULL, 0, 0, NULL, kinds, AT(kind), "what lies on the turntable"},
    {"seed", OPTION_INT, NULL, 0, 1e9, "1", NULL, AT(seed), "seed of the sample's irregularities"},
    {"width_mm", OPTION_DOUBLE, "mm", 1, 1000, "50", NULL, AT(width_mm), "size along x"},
    {"height_mm", OPTION_DOUBLE, "mm", 1, 1000, "50", NULL, AT(height_mm), "size along y"},
    {"base_mm", OPTION_DOUBLE, "mm", 0, 100, "1", NULL, AT(base_mm),
     "height of the structure's deepest points above the turntable's top"},
    {"relief_mm", OPTION_DOUBLE, "mm", 0, 100, "3", NULL, AT(relief_mm),
     "approximate depth of the structure"},
    {"top_mm", OPTION_DOUBLE, "mm", 0.1, 200, "5", NULL, AT(top_mm),
     "height of the reference plane; no part of the sample may be higher"},
    {"period_mm", OPTION_DOUBLE, "mm", 0.1, 1000, "6.25", NULL, AT(period_mm),
     "distance between yarns, ridges, courses of bricks or rings; rounded so that the sample "
     "tiles"},
    {"grid", OPTION_INT, NULL, 2, 2048, "224", NULL, AT(grid),
     "number of cells in x and in y, of a sample that is a relief"},
    {"repeats", OPTION_INT, NULL, 1, 16, "1", NULL, AT(repeats),
     "number of equal pieces in x and in y, which join without a seam; more than 1 for flat, "
     "brushed, brick, ridges, grass, bluepipe, block and mail"},
    {"albedo", OPTION_DOUBLES, NULL, 0, 1, "", NULL, AT(albedo),
     "diffuse albedo, one number or red;green;blue; empty: the value of the kind"},
    {"albedo2", OPTION_DOUBLES, NULL, 0, 1, "", NULL, AT(albedo2),
     "albedo of the second colour: weft, mortar"},
    {"gloss", OPTION_DOUBLE, NULL, -1, 1, "-1", NULL, AT(gloss),
     "albedo of the gloss; -1: the value of the kind"},
    {"roughness_along", OPTION_DOUBLE, NULL, -1, 1, "-1", NULL, AT(along),
     "roughness of the gloss along the fibres or scratches; -1: the value of the kind"},
    {"roughness_across", OPTION_DOUBLE, NULL, -1, 1, "-1", NULL, AT(across),
     "roughness of the gloss across the fibres or scratches; -1: the value of the kind"},
    {"places_mm", OPTION_DOUBLES, "mm", -500, 500, "", NULL, AT(places_mm),
     "poles: x;y;height of each post; balls: x;y;radius of each; they stand on base_mm"},
    {"radius_mm", OPTION_DOUBLE, "mm", 0.01, 100, "1", NULL, AT(radius_mm), "radius of the posts"},
    {"smooth", OPTION_BOOL, NULL, 0, 0, "no", NULL, AT(smooth),
     "obj: shade the surface with interpolated normals"},
    {"path", OPTION_PATH, NULL, 0, 0, "", NULL, AT(path),
     "picture: PNG of the relief, in which black is base_mm high and white is relief_mm higher; "
     "obj: mesh in mm, z up"},
    {"albedo_path", OPTION_PATH, NULL, 0, 0, "", NULL, AT(albedo_path),
     "picture: PNG of the colours; plate: PNG of the print, in which each pixel is a rectangle"},
    {"tilt_deg", OPTION_DOUBLE, "deg", 0, 60, "0", NULL, AT(tilt_deg),
     "plate: angle by which the plate leans, its lowest corner on the turntable"},
    {"tilt_towards_deg", OPTION_DOUBLE, "deg", -360, 360, "0", NULL, AT(tilt_towards_deg),
     "plate: azimuth towards which the plate's normal leans"},
    {"turn_deg", OPTION_DOUBLE, "deg", -360, 360, "0", NULL, AT(turn_deg),
     "plate: rotation about the plate's normal"},
    {"offset_mm", OPTION_DOUBLES, "mm", -200, 200, "", NULL, AT(offset_mm),
     "plate: x;y of the plate's middle"},
    {0},
};
#undef AT

struct mesh *sample_mesh_new(void) {
    struct mesh *mesh = g_new(struct mesh, 1);
    mesh->vertices = g_array_new(FALSE, FALSE, sizeof(struct vertex));
    mesh->triangles = g_array_new(FALSE, FALSE, 3 * sizeof(guint32));
    return mesh;
}

void sample_free(struct mesh *mesh) {
    if (!mesh)
        return;
    g_array_unref(mesh->vertices);
    g_array_unref(mesh->triangles);
    g_free(mesh);
}

guint32 sample_add_vertex(struct mesh *mesh, const struct vertex *vertex) {
    g_array_append_vals(mesh->vertices, vertex, 1);
    return mesh->vertices->len - 1;
}

void sample_add_triangle(struct mesh *mesh, guint32 a, guint32 b, guint32 c) {
    guint32 corners[3] = {a, b, c};
    g_array_append_vals(mesh->triangles, corners, 1);
}

void sample_add_quad(struct mesh *mesh, guint32 a, guint32 b, guint32 c, guint32 d) {
    sample_add_triangle(mesh, a, b, c);
    sample_add_triangle(mesh, a, c, d);
}

void sample_join_rings(struct mesh *mesh, guint32 first, guint32 n, guint32 around, gboolean flip) {
    for (guint32 i = 0; i < n; i++)
        for (guint32 k = 0; k < around; k++) {
            guint32 a = first + i * around + k, b = first + i * around + (k + 1) % around;
            guint32 c = b + around, d = a + around;
            if (flip)
                sample_add_quad(mesh, d, c, b, a);
            else
                sample_add_quad(mesh, a, b, c, d);
        }
}

int sample_count(double length_mm, double period_mm, int unit) {
    return unit * (int)MAX(1, rint(length_mm / period_mm / unit));
}

static struct vertex *vertex_at(struct mesh *mesh, guint32 i) {
    return &g_array_index(mesh->vertices, struct vertex, i);
}

void sample_smooth_normals(struct mesh *mesh, guint first_vertex, guint first_triangle) {
    for (guint i = first_vertex; i < mesh->vertices->len; i++)
        memset(vertex_at(mesh, i)->n, 0, sizeof(float[3]));
    const guint32(*triangles)[3] = (const guint32(*)[3])(gpointer)mesh->triangles->data;
    for (guint i = first_triangle; i < mesh->triangles->len; i++) {
        const float *a = vertex_at(mesh, triangles[i][0])->p,
                    *b = vertex_at(mesh, triangles[i][1])->p,
                    *c = vertex_at(mesh, triangles[i][2])->p;
        float u[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
        float v[3] = {c[0] - a[0], c[1] - a[1], c[2] - a[2]};
        float n[3] = {u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2],
                      u[0] * v[1] - u[1] * v[0]};
        for (int corner = 0; corner < 3; corner++)
            for (int k = 0; k < 3; k++)
                vertex_at(mesh, triangles[i][corner])->n[k] += n[k];
    }
    for (guint i = first_vertex; i < mesh->vertices->len; i++) {
        float *n = vertex_at(mesh, i)->n, s = sqrtf(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
        if (s > 0)
            for (int k = 0; k < 3; k++)
                n[k] /= s;
        else
            n[2] = 1;
    }
}

void sample_set_rgb(float to[3], const struct option_doubles *given, float r, float g, float b) {
    const float own[3] = {r, g, b};
    for (int k = 0; k < 3; k++)
        to[k] = given->n == 0 ? own[k] : (float)given->values[given->n == 1 ? 0 : k];
}

void sample_set_gloss(struct vertex *to, const struct sample_options *options, double gloss,
                      double along, double across) {
    to->gloss = (float)(options->gloss >= 0 ? options->gloss : gloss);
    to->along = (float)(options->along > 0 ? options->along : along);
    to->across = (float)(options->across > 0 ? options->across : across);
}

static double lattice(gint64 x, gint64 y, guint64 seed) {
    guint64 h = sample_hash(seed ^ ((guint64)x * 0x9e3779b97f4a7c15u) ^
                            sample_hash((guint64)y + 0x632be59bd9b4e019u));
    return (double)(h >> 11) * 0x1p-52 - 1;
}

static gint64 wrap(gint64 i, int period) {
    gint64 rest = i % period;
    return rest < 0 ? rest + period : rest;
}

double sample_noise(double x, double y, int period_x, int period_y, guint64 seed) {
    double fx = floor(x), fy = floor(y), u = x - fx, v = y - fy;
    gint64 x0 = wrap((gint64)fx, period_x), x1 = wrap(x0 + 1, period_x);
    gint64 y0 = wrap((gint64)fy, period_y), y1 = wrap(y0 + 1, period_y);
    u = u * u * (3 - 2 * u);
    v = v * v * (3 - 2 * v);
    double low = lattice(x0, y0, seed) * (1 - u) + lattice(x1, y0, seed) * u;
    double high = lattice(x0, y1, seed) * (1 - u) + lattice(x1, y1, seed) * u;
    return low * (1 - v) + high * v;
}

/* Adds a wall from an edge down to z = 0. The edge has the n vertices first, first + step, first +
 * 2 step and so on. The wall gets copies of these vertices, with the normal (nx, ny, 0). */
static void add_wall(struct mesh *mesh, guint32 first, guint32 step, guint32 n, float nx,
                     float ny) {
    guint32 before[2] = {0, 0};
    for (guint32 i = 0; i < n; i++) {
        struct vertex top = *vertex_at(mesh, first + i * step);
        top.n[0] = nx;
        top.n[1] = ny;
        top.n[2] = 0;
        struct vertex bottom = top;
        bottom.p[2] = 0;
        guint32 here[2] = {sample_add_vertex(mesh, &top), sample_add_vertex(mesh, &bottom)};
        if (i > 0)
            sample_add_quad(mesh, before[1], here[1], here[0], before[0]);
        memcpy(before, here, sizeof before);
    }
}

/* Allocates memory for this number of further elements at once. Otherwise a growing array would be
 * copied again and again. */
static void reserve(GArray *array, guint more) {
    const guint n = array->len;
    g_array_set_size(array, n + more);
    g_array_set_size(array, n);
}

void sample_add_relief(struct mesh *mesh, const struct sample_options *options, int nx, int ny,
                       SampleRelief relief, gconstpointer data) {
    reserve(mesh->vertices, (guint)(nx + 1) * (guint)(ny + 1));
    reserve(mesh->triangles, 2 * (guint)nx * (guint)ny);
    guint32 first = mesh->vertices->len, columns = (guint32)nx + 1;
    for (int j = 0; j <= ny; j++) {
        for (int i = 0; i <= nx; i++) {
            struct vertex vertex = {.n = {0, 0, 1}, .t = {1, 0, 0}, .along = 1, .across = 1};
            vertex.p[0] = (float)(options->width_mm * ((double)i / nx - 0.5));
            vertex.p[1] = (float)(options->height_mm * ((double)j / ny - 0.5));
            relief(&vertex, data);
            sample_add_vertex(mesh, &vertex);
        }
    }
    guint first_triangle = mesh->triangles->len;
    for (guint32 j = 0; j < (guint32)ny; j++)
        for (guint32 i = 0; i < (guint32)nx; i++) {
            guint32 a = first + j * columns + i;
            sample_add_quad(mesh, a, a + 1, a + 1 + columns, a + columns);
        }
    sample_smooth_normals(mesh, first, first_triangle);
    guint32 rows = (guint32)ny + 1, last = first + rows * columns - 1;
    add_wall(mesh, first, 1, columns, 0, -1);
    add_wall(mesh, last, -1u, columns, 0, 1);
    add_wall(mesh, first + columns - 1, columns, rows, 1, 0);
    add_wall(mesh, last + 1 - columns, -columns, rows, -1, 0);
}

static gboolean check_rgb(const struct config_section *section, const char *key,
                          const struct option_doubles *list, Mistakes *mistakes) {
    return list->n == 0 || list->n == 1 || list->n == 3 ||
           config_mistake(mistakes, CONFIG_ERROR_VALUE, section, key,
                          "has %d numbers; give one number, or three (red;green;blue)", list->n);
}

static gboolean check_options(const struct config_section *section,
                              const struct sample_options *options, Mistakes *mistakes) {
    gboolean good = check_rgb(section, "albedo", &options->albedo, mistakes);
    good &= check_rgb(section, "albedo2", &options->albedo2, mistakes);
    if (MAX(options->width_mm, options->height_mm) > 200 * options->period_mm)
        good = config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "period_mm",
                              "%g mm is too short for a sample of this size, which may have at "
                              "most 200 periods; give at least %g mm",
                              options->period_mm, MAX(options->width_mm, options->height_mm) / 200);
    const gboolean whole = options->kind == SAMPLE_WEAVE || options->kind == SAMPLE_PEANUTS ||
                           (options->kind >= SAMPLE_PICTURE && options->kind <= SAMPLE_PLATE);
    if (options->repeats > 1 && whole)
        good = config_mistake(
            mistakes, CONFIG_ERROR_VALUE, section, "repeats",
            "is %d, but a sample of kind %s consists of one piece; remove the key repeats",
            options->repeats, kinds[options->kind]);
    gboolean placed = options->kind == SAMPLE_POLES || options->kind == SAMPLE_BALLS;
    if (placed && (options->places_mm.n == 0 || options->places_mm.n % 3 != 0))
        good = placed = config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "places_mm",
                                       "needs three numbers for each post (x;y;height) or each "
                                       "ball (x;y;radius), but has %d in all; correct the list",
                                       options->places_mm.n);
    for (int i = 2; placed && i < options->places_mm.n; i += 3)
        if (options->places_mm.values[i] <= 0)
            good = config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "places_mm",
                                  "number %d, the height of a post or the radius of a ball, is %g; "
                                  "give a value above 0",
                                  i + 1, options->places_mm.values[i]);
    if (options->offset_mm.n != 0 && options->offset_mm.n != 2)
        good = config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "offset_mm",
                              "needs two numbers (x;y), but has %d", options->offset_mm.n);
    if (options->kind == SAMPLE_PLATE && !*options->albedo_path)
        good = config_mistake(
            mistakes, CONFIG_ERROR_MISSING, section, "albedo_path",
            "is missing; a plate needs the PNG picture that is printed on the plate");
    const gboolean loaded = options->kind == SAMPLE_PICTURE || options->kind == SAMPLE_OBJ;
    if (loaded && !*options->path)
        good = config_mistake(mistakes, CONFIG_ERROR_MISSING, section, "path",
                              "is missing; a sample of kind %s needs the path of the file to load",
                              kinds[options->kind]);
    return good;
}

/* Checks that a mesh lies between z = 0 and top_mm. This is the only such check. With a mesh
 * outside of these bounds, the data would be wrong. */
static gboolean check_mesh(const struct config_section *section,
                           const struct sample_options *options, const struct mesh *mesh,
                           Mistakes *mistakes) {
    double low = G_MAXDOUBLE, high = -G_MAXDOUBLE;
    for (guint i = 0; i < mesh->vertices->len; i++) {
        const float *p = g_array_index(mesh->vertices, struct vertex, i).p;
        low = MIN(low, (double)p[2]);
        high = MAX(high, (double)p[2]);
    }
    if (mesh->triangles->len && low >= -1e-6 && high <= options->top_mm + 1e-6)
        return TRUE;
    if (!mesh->triangles->len)
        return config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "kind",
                              "the file %s has no face; give an OBJ file with lines that begin "
                              "with “f ”",
                              options->path);
    return config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "kind",
                          "the sample extends from %g mm to %g mm above the turntable, but must "
                          "be between 0 and top_mm = %g; change top_mm, base_mm or relief_mm (obj: "
                          "the mesh; poles and balls: places_mm; plate: tilt_deg)",
                          low, high, options->top_mm);
}

static struct mesh *make(const struct sample_options *options, GError **error) {
    switch ((enum sample_kind)options->kind) {
    case SAMPLE_WEAVE:
        return sample_weave(options);
    case SAMPLE_PEANUTS:
        return sample_peanuts(options);
    case SAMPLE_GRASS:
        return sample_grass(options);
    case SAMPLE_BLUEPIPE:
        return sample_bluepipe(options);
    case SAMPLE_BLOCK:
        return sample_block(options);
    case SAMPLE_MAIL:
        return sample_mail(options);
    case SAMPLE_PICTURE:
        return sample_picture(options, error);
    case SAMPLE_PLATE:
        return sample_plate(options, error);
    case SAMPLE_OBJ:
        return sample_obj(options, error);
    case SAMPLE_POLES:
    case SAMPLE_BALLS:
        return sample_targets(options);
    default:
        return sample_relief(options);
    }
}

struct mesh *sample_new(const struct config_section *section, const struct sample_options *options,
                        Mistakes *mistakes) {
    GError *error = NULL;
    if (!check_options(section, options, mistakes))
        return NULL;
    struct mesh *mesh = make(options, &error);
    mistakes_add(mistakes, error);
    if (!mesh || check_mesh(section, options, mesh, mistakes))
        return mesh;
    sample_free(mesh);
    return NULL;
}
