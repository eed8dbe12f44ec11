#include "viewer.h"

#include "backdrop.h"
#include "base/direction.h"
#include "camera.h"
#include "drawing/gl/gpu.h"
#include "drawing/gl/places.h"
#include "drawing/methods/eigenmaps_view.h"
#include "drawing/methods/methods.h"
#include "drawing/relief/relief.h"
#include "hatching.h"
#include "lamp.h"
#include "programs.h"
#include "shapes/mesh_shape.h"

#include <epoxy/gl.h>
#include <math.h>
#include <stddef.h>
#include <string.h>

#define MAX_SAMPLES (1 << 26)

#define ENDLESS_LOOKS 10 /* number of pictures of the sample from which hexagons are chosen */

/* Geometry programs: for the first lamp, for a further lamp, and for a further lamp with shadow. */
enum { GEOMETRY_FIRST, GEOMETRY_FURTHER, GEOMETRY_FURTHER_SHADOWS, GEOMETRIES };

/* A material. Its MDF is the relief's MDF with the same number. */
struct viewer_material {
    const struct method *method;
    gpointer material;  /* an object of the method */
    Programs *programs; /* programs of the method */
    double tiles; /* tiles per unit of the texture coordinates; not used for the main material */
};

struct Viewer {
    struct viewer_material materials[VIEWER_MAX_MATERIALS];
    int n_materials;             /* at least 1, for the main material, which may be empty */
    IndexTexture *index;         /* index map of the main material; NULL if there is none */
    struct index_map *index_map; /* the same map on the CPU */
    Endless *endless;            /* hexagons of the material; NULL until a picture needs them */
    struct mesh_part *parts;     /* of the mesh */
    int n_parts;
    Relief *relief;
    Backdrop *backdrop;
    Hatching *hatching;
    guint plain_program, geometry_programs[GEOMETRIES], resolve_program;
    guint array, vertices, shapes, indices; /* GL vertex array and the buffers of the mesh */
    /* `n_casting` is the number of indices without the floor, because the floor casts no shadow.
     * `serial` is the number of meshes that have been set so far. */
    guint n_indices, n_casting, serial;
    double radius, tiles_u, tiles_v; /* of the mesh */
    double reach;  /* radius of a sphere around the origin that contains the mesh and its floor */
    float *points; /* positions of the mesh's vertices without the floor: n_points × 3 */
    guint n_points;
    struct gpu_target scene, geometry, picture;
};

void viewer_vertex_attributes(void) {
    static const struct {
        int n;
        gsize offset;
    } attributes[VIEWER_VERTEX_ATTRIBUTES] = {{3, offsetof(struct vertex, position)},
                                              {3, offsetof(struct vertex, normal)},
                                              {4, offsetof(struct vertex, tangent)},
                                              {2, offsetof(struct vertex, uv)}};
    for (guint k = 0; k < VIEWER_VERTEX_ATTRIBUTES; k++) {
        glVertexAttribPointer(k, attributes[k].n, GL_FLOAT, GL_FALSE, sizeof(struct vertex),
                              (const void *)attributes[k].offset);
        glEnableVertexAttribArray(k);
    }
}

static void make_array(Viewer *viewer) {
    const guint n = VIEWER_VERTEX_ATTRIBUTES;
    glGenVertexArrays(1, &viewer->array);
    glGenBuffers(1, &viewer->vertices);
    glGenBuffers(1, &viewer->shapes);
    glGenBuffers(1, &viewer->indices);
    glBindVertexArray(viewer->array);
    glBindBuffer(GL_ARRAY_BUFFER, viewer->vertices);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, viewer->indices);
    viewer_vertex_attributes();
    glBindBuffer(GL_ARRAY_BUFFER, viewer->shapes);
    glVertexAttribPointer(n, 2, GL_FLOAT, GL_FALSE, sizeof(struct vertex_shape), NULL);
    glVertexAttribPointer(n + 1, 3, GL_FLOAT, GL_FALSE, sizeof(struct vertex_shape),
                          (const void *)offsetof(struct vertex_shape, bend));
    glVertexAttribPointer(n + 2, 4, GL_FLOAT, GL_FALSE, sizeof(struct vertex_shape),
                          (const void *)offsetof(struct vertex_shape, stretch));
    for (guint k = n; k < n + 3; k++)
        glEnableVertexAttribArray(k);
    glBindVertexArray(0);
}

/* Returns geometry program number `which`, and compiles it when it is first used. Returns 0 on
 * error. */
static guint geometry_program(Viewer *viewer, int which, GError **error) {
    static const char *const names[] = {
        "mesh.vert",    "frame.glsl",  "visible.glsl",  "shadow.glsl",
        "further.glsl", "curved.glsl", "geometry.frag", NULL};
    static const char *const constants[GEOMETRIES] = {
        "#define SOFT_SHADOWS\n#define CURVED 1\n#define FURTHER 0\n#define LAMP_SHADOWS 0\n",
        "#define SOFT_SHADOWS\n#define CURVED 1\n#define FURTHER 1\n#define LAMP_SHADOWS "
        "0\n#define NEAR_LAMPS\n",
        "#define SOFT_SHADOWS\n#define CURVED 1\n#define FURTHER 1\n#define LAMP_SHADOWS "
        "1\n#define NEAR_LAMPS\n"};
    guint *program = &viewer->geometry_programs[which];
    if (*program == 0)
        *program = gpu_program(constants[which], names, error);
    return *program;
}

Viewer *viewer_new(const struct eigenmaps *material, GError **error) {
    const char *const plain[] = {"mesh.vert", "frame.glsl", "plain.frag", NULL};
    const char *const resolve[] = {"screen.vert", "tone.glsl", "resolve.frag", NULL};
    g_autoptr(Viewer) viewer = g_new0(Viewer, 1);
    viewer->radius = viewer->reach = 1.0;
    viewer->n_materials = 1;
    if ((viewer->plain_program = gpu_program("", plain, error)) == 0 ||
        !geometry_program(viewer, GEOMETRY_FIRST, error) ||
        (viewer->resolve_program = gpu_program("", resolve, error)) == 0 ||
        (viewer->relief = relief_new(error)) == NULL ||
        (viewer->backdrop = backdrop_new(error)) == NULL ||
        (viewer->hatching = hatching_new(error)) == NULL ||
        (material != NULL && !viewer_set_material(viewer, material, error)))
        return NULL;
    make_array(viewer);
    return g_steal_pointer(&viewer);
}

static void material_clear(struct viewer_material *m) {
    if (m->method != NULL)
        m->method->free(m->material);
    programs_free(m->programs);
    *m = (struct viewer_material){NULL};
}

void viewer_free(Viewer *viewer) {
    if (viewer == NULL)
        return;
    for (int k = 0; k < viewer->n_materials; k++)
        material_clear(&viewer->materials[k]);
    index_texture_free(viewer->index);
    index_map_free(viewer->index_map);
    endless_free(viewer->endless);
    relief_free(viewer->relief);
    backdrop_free(viewer->backdrop);
    hatching_free(viewer->hatching);
    glDeleteProgram(viewer->plain_program);
    for (int k = 0; k < GEOMETRIES; k++)
        glDeleteProgram(viewer->geometry_programs[k]);
    glDeleteProgram(viewer->resolve_program);
    glDeleteVertexArrays(1, &viewer->array);
    glDeleteBuffers(1, &viewer->vertices);
    glDeleteBuffers(1, &viewer->shapes);
    glDeleteBuffers(1, &viewer->indices);
    gpu_target_clear(&viewer->scene);
    gpu_target_clear(&viewer->geometry);
    gpu_target_clear(&viewer->picture);
    g_free(viewer->points);
    g_free(viewer->parts);
    g_free(viewer);
}

/* Replaces the method and the material of m, and takes ownership of material. Compiles the programs
 * of a new method. Returns FALSE if a program cannot be compiled. Then nothing is changed, and the
 * caller still owns material. */
static gboolean material_set(struct viewer_material *m, const struct method *method,
                             gpointer material, GError **error) {
    if (m->method != method) {
        g_autoptr(Programs) programs = programs_new(method);
        const struct places_source repeated = {NULL, NULL};
        if (!programs_get(programs, PROGRAM_SURFACE, material, &repeated, &viewer_settings_default,
                          error))
            return FALSE;
        programs_free(m->programs);
        m->programs = g_steal_pointer(&programs);
    }
    if (m->method != NULL)
        m->method->free(m->material);
    m->method = method;
    m->material = material;
    return TRUE;
}

gboolean viewer_set_method(Viewer *viewer, const struct method *method, gpointer material,
                           GError **error) {
    if (!material_set(&viewer->materials[0], method, material, error))
        return FALSE;
    if (viewer->endless != NULL)
        relief_forget(viewer->relief);
    g_clear_pointer(&viewer->endless, endless_free);
    return TRUE;
}

/* Sets the main material, and takes ownership of material even on failure. If material is NULL, the
 * caller has already set the error, and the function only returns FALSE. */
static gboolean take(Viewer *viewer, const struct method *method, gpointer material,
                     GError **error) {
    if (material == NULL || viewer_set_method(viewer, method, material, error))
        return material != NULL;
    method->free(material);
    return FALSE;
}

gboolean viewer_open(Viewer *viewer, const struct method *method, const char *path,
                     GError **error) {
    return take(viewer, method, method_open(method, path, error), error);
}

int viewer_add_material(Viewer *viewer, const struct method *method, const char *path, double tiles,
                        GError **error) {
    const int n = viewer->n_materials;
    struct viewer_material *m = &viewer->materials[MIN(n, VIEWER_MAX_MATERIALS - 1)];
    if (n >= VIEWER_MAX_MATERIALS) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                    "%s: a scene has at most %d materials; leave some out", path,
                    VIEWER_MAX_MATERIALS);
        return -1;
    }
    gpointer material = method_open(method, path, error);
    if (material == NULL || !material_set(m, method, material, error)) {
        if (material != NULL)
            method->free(material);
        material_clear(m);
        return -1;
    }
    m->tiles = tiles;
    return viewer->n_materials++;
}

gboolean viewer_set_material(Viewer *viewer, const struct eigenmaps *material, GError **error) {
    return take(viewer, &method_eigenmaps, eigenmaps_view_new(material, error), error);
}

gboolean viewer_set_material_mdf(Viewer *viewer, int material, const struct mdf_source *mdf,
                                 GError **error) {
    return relief_set_mdf(viewer->relief, material, mdf, error);
}

gboolean viewer_set_mdf(Viewer *viewer, const struct mdf_source *mdf, GError **error) {
    return viewer_set_material_mdf(viewer, 0, mdf, error);
}

gboolean viewer_open_material_mdf(Viewer *viewer, int material, const char *path, GError **error) {
    struct mdf_source *mdf = mdf_source_read(path, error);
    gboolean good = mdf != NULL && relief_set_mdf(viewer->relief, material, mdf, error);
    if (mdf != NULL && !good)
        g_prefix_error(error, "%s: ", path);
    mdf_source_free(mdf);
    return good;
}

gboolean viewer_open_mdf(Viewer *viewer, const char *path, GError **error) {
    return viewer_open_material_mdf(viewer, 0, path, error);
}

gboolean viewer_set_index(Viewer *viewer, const struct index_map *map, GError **error) {
    IndexTexture *index = map != NULL ? index_texture_new(map, error) : NULL;
    if (map != NULL && index == NULL)
        return FALSE;
    struct index_map *copy = map != NULL ? index_map_copy(map) : NULL;
    index_texture_free(viewer->index);
    index_map_free(viewer->index_map);
    viewer->index = index;
    viewer->index_map = copy;
    relief_forget(viewer->relief);
    return TRUE;
}

gboolean viewer_open_index(Viewer *viewer, const char *path, GError **error) {
    g_autoptr(IndexMap) map = index_map_read(path, error);
    const struct viewer_material *m = &viewer->materials[0];
    int size[2];
    if (map == NULL)
        return FALSE;
    if (m->method != NULL && m->method->texels != NULL && m->method->texels(m->material, size) &&
        (map->sample_width != size[0] || map->sample_height != size[1])) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                    "%s is an index map for a sample of %d × %d texels, but the material has %d × "
                    "%d; synthesize the map from this material",
                    path, map->sample_width, map->sample_height, size[0], size[1]);
        return FALSE;
    }
    return viewer_set_index(viewer, map, error);
}

const struct index_map *viewer_index(const Viewer *viewer) {
    return viewer->index_map;
}

/* Returns the index map or the hexagons of a material. Both are NULL for any other material than
 * the main material, and if the method has no material file. */
static struct places_source places(const Viewer *viewer, int material,
                                   const struct viewer_settings *s) {
    const struct method *method = viewer->materials[0].method;
    if (material > 0 || method == NULL || method->product == NULL)
        return (struct places_source){NULL, NULL};
    return (struct places_source){
        viewer->index, viewer->index == NULL && s->endless && !s->plain ? viewer->endless : NULL};
}

void viewer_whole_tiles(const Viewer *viewer, double *u, double *v) {
    double period[2];
    if (viewer->index == NULL)
        return;
    index_texture_period(viewer->index, period);
    const double rounded = MAX(1, round(*v / period[1])) * period[1];
    *u = MAX(1, round(*u * rounded / *v / period[0])) * period[0];
    *v = rounded;
}

gboolean viewer_set_environment(Viewer *viewer, const struct environment *environment,
                                GError **error) {
    return backdrop_set_environment(viewer->backdrop, environment, error);
}

struct viewer_memory viewer_memory(const Viewer *viewer) {
    gint64 materials = 0;
    for (int k = 0; k < viewer->n_materials; k++)
        if (viewer->materials[k].method != NULL)
            materials += viewer->materials[k].method->bytes(viewer->materials[k].material);
    return (struct viewer_memory){materials, relief_mdf_bytes(viewer->relief),
                                  index_texture_bytes(viewer->index)};
}

gboolean viewer_set_mesh(Viewer *viewer, const struct mesh *mesh, GError **error) {
    const struct mesh_part whole = {0, mesh->n_indices, 0};
    if (mesh->n_parts > VISIBILITY_MAX_PARTS) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                    "%s: the shape has %u parts, but at most %d can be drawn; join parts of the "
                    "same material",
                    mesh->name, mesh->n_parts, VISIBILITY_MAX_PARTS);
        return FALSE;
    }
    g_free(viewer->parts);
    viewer->n_parts = mesh->n_parts > 0 ? (int)mesh->n_parts : 1;
    viewer->parts =
        g_memdup2(mesh->n_parts > 0 ? mesh->parts : &whole, (gsize)viewer->n_parts * sizeof whole);
    g_autofree struct vertex_shape *shapes = mesh_shapes(mesh);
    glBindVertexArray(viewer->array);
    glBindBuffer(GL_ARRAY_BUFFER, viewer->vertices);
    glBufferData(GL_ARRAY_BUFFER, mesh->n_vertices * sizeof(struct vertex), mesh->vertices,
                 GL_STATIC_DRAW);
    glBufferData(GL_ELEMENT_ARRAY_BUFFER, mesh->n_indices * sizeof(guint32), mesh->indices,
                 GL_STATIC_DRAW);
    glBindBuffer(GL_ARRAY_BUFFER, viewer->shapes);
    glBufferData(GL_ARRAY_BUFFER, mesh->n_vertices * sizeof(struct vertex_shape), shapes,
                 GL_STATIC_DRAW);
    glBindVertexArray(0);
    viewer->serial++;
    viewer->n_indices = mesh->n_indices;
    viewer->n_casting = mesh->n_indices - mesh->n_floor_indices;
    viewer->tiles_u = mesh->tiles_u;
    viewer->tiles_v = mesh->tiles_v;
    viewer->radius = viewer->reach = mesh->radius;
    viewer->n_points = mesh->n_vertices - mesh->n_floor_vertices;
    g_free(viewer->points);
    viewer->points = g_new(float, 3 * (gsize)viewer->n_points);
    for (guint k = 0; k < mesh->n_vertices; k++) {
        const float *p = mesh->vertices[k].position;
        if (k < viewer->n_points)
            memcpy(viewer->points + 3 * (gsize)k, p, 3 * sizeof(float));
        else
            viewer->reach = MAX(viewer->reach, sqrtf(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]));
    }
    backdrop_set_points(viewer->backdrop, viewer->points, viewer->n_points, viewer->radius);
    return gpu_check("the mesh", error);
}

void viewer_fit(const Viewer *viewer, struct viewer_settings *settings, double aspect) {
    if (settings->camera_distance == 0.0 && viewer->n_points > 0)
        camera_fit(settings, viewer->points, viewer->n_points, viewer->radius, aspect);
}

/* Returns the numbers of tiles of the main material. */
static void main_tiles(const Viewer *viewer, const struct viewer_settings *s, double ret[2]) {
    ret[0] = s->tiles_u;
    ret[1] = s->tiles_v;
    if (s->tiles_u > 0.0 && s->tiles_v > 0.0)
        return;
    ret[0] = viewer->tiles_u;
    ret[1] = viewer->tiles_v;
    if (places(viewer, 0, s).index != NULL)
        viewer_whole_tiles(viewer, &ret[0], &ret[1]);
}

/* Makes viewer->endless if the settings need it and it does not exist yet. The centres of the
 * hexagons are chosen from pictures of the sample for some views and lights. */
static gboolean make_endless(Viewer *viewer, const struct viewer_settings *s, GError **error) {
    const struct viewer_material *m = &viewer->materials[0];
    int size[2];
    if (!s->endless || s->plain || viewer->endless != NULL || m->method->texels == NULL ||
        !m->method->texels(m->material, size))
        return TRUE;
    struct viewer_settings nearest = *s;
    nearest.style.nearest = TRUE;
    const int width = MIN(size[0], ENDLESS_SIDE), height = MIN(size[1], ENDLESS_SIDE);
    const gsize values = 3 * (gsize)width * (gsize)height;
    g_autofree float *all = g_new(float, values *ENDLESS_LOOKS);
    for (gsize k = 0; k < ENDLESS_LOOKS; k++) {
        float v[3], l[3];
        direction_from_deg(10.0 + 50.0 * (double)(k % 5) / 4, 100.0 * (double)k, v);
        direction_from_deg(15.0 + 45.0 * (double)(k * 3 % 7) / 6, 160.0 * (double)k + 60, l);
        g_autofree float *flat = viewer_render_flat(viewer, &nearest, v, l, width, height, error);
        if (flat == NULL)
            return FALSE;
        for (gsize i = 0; i < values; i++)
            all[i / 3 * ENDLESS_LOOKS * 3 + 3 * k + i % 3] = flat[i / 3 * 4 + i % 3];
    }
    const struct endless_pictures pictures = {width, height, ENDLESS_LOOKS * 3, all};
    viewer->endless = endless_new(size[0], size[1], &pictures);
    return TRUE;
}

const struct endless *viewer_endless(const Viewer *viewer, const struct viewer_settings *s,
                                     struct endless_lattice *ret) {
    const struct endless *endless = places(viewer, 0, s).endless;
    double tiles[2];
    main_tiles(viewer, s, tiles);
    if (endless != NULL)
        endless_lattice_init(ret, endless, (float)tiles[0], (float)tiles[1]);
    return endless;
}

/* Returns the number of a part's material, or the number of the main material if the part's
 * material does not exist yet. */
static int part_material(const Viewer *viewer, int part) {
    const int material = viewer->parts[part].material;
    return material < viewer->n_materials ? material : 0;
}

static void draw_part(Viewer *viewer, guint program, const struct viewer_settings *s,
                      const struct relief_scene *scene, int part) {
    const struct visibility_part *drawn = &scene->seen.parts[part];
    const struct viewer_material *m = &viewer->materials[drawn->material];
    glUseProgram(program);
    m->method->bind(m->material, program, &s->style);
    relief_bind(viewer->relief, drawn->material, program);
    places_bind(&drawn->places, drawn->tiles, program);
    glUniformMatrix4fv(glGetUniformLocation(program, "projection"), 1, GL_FALSE,
                       scene->seen.projection);
    glUniform2fv(glGetUniformLocation(program, "tiles"), 1, drawn->tiles);
    glUniform3fv(glGetUniformLocation(program, "eye"), 1, scene->seen.sight);
    glUniform3fv(glGetUniformLocation(program, "light"), 1, scene->light);
    glUniform1f(glGetUniformLocation(program, "ambient_light"), s->ambient);
    glUniform1f(glGetUniformLocation(program, "material"), 1.0F + (float)drawn->material);
    programs_set_lamps(program, s, viewer->radius);
    glDisable(GL_BLEND);
    glDisable(GL_CULL_FACE);
    glEnable(GL_DEPTH_TEST);
    glDepthFunc(GL_LESS);
    glDepthMask(GL_TRUE);
    glBindVertexArray(viewer->array);
    glDrawElements(GL_TRIANGLES, (GLsizei)drawn->n_indices, GL_UNSIGNED_INT,
                   (const char *)NULL + sizeof(guint32) * (gsize)drawn->first_index);
    glBindVertexArray(0);
}

/* Draws the mesh. All parts are drawn with `program`. If `program` is 0, each part is drawn with
 * the program of its material. Fails if the program of a material cannot be compiled. */
static gboolean draw_mesh(Viewer *viewer, guint program, const struct viewer_settings *s,
                          const struct relief_scene *scene, GError **error) {
    const enum program_kind kind = s->silhouettes || s->shadows ? PROGRAM_RELIEF : PROGRAM_SURFACE;
    for (int k = 0; k < viewer->n_parts; k++) {
        const struct visibility_part *part = &scene->seen.parts[k];
        const struct viewer_material *m = &viewer->materials[part->material];
        const guint own =
            program != 0 ? program
                         : programs_get(m->programs, kind, m->material, &part->places, s, error);
        if (own == 0)
            return FALSE;
        draw_part(viewer, own, s, scene, k);
    }
    return TRUE;
}

static void viewer_parts(const Viewer *viewer, const struct viewer_settings *s,
                         struct visibility_scene *ret) {
    double tiles[2];
    main_tiles(viewer, s, tiles);
    ret->array = viewer->array;
    ret->n_parts = viewer->n_parts;
    for (int k = 0; k < viewer->n_parts; k++) {
        const int material = part_material(viewer, k);
        const double own = viewer->materials[material].tiles;
        ret->parts[k] = (struct visibility_part){
            .places = places(viewer, material, s),
            .tiles = {(float)(material > 0 ? own : tiles[0]),
                      (float)(material > 0 ? own : tiles[1])},
            .first_index = viewer->parts[k].first_index,
            .n_indices = viewer->parts[k].n_indices,
            .material = material,
        };
    }
}

/* Computes the scene as the camera sees it, and prepares the relief for it: the visible surface and
 * the shadow maps. */
static gboolean look(const Viewer *viewer, const struct viewer_settings *s, int width, int height,
                     struct relief_scene *ret, GError **error) {
    struct viewer_settings fitted = *s;
    const double aspect = (double)width / height;
    *ret = (struct relief_scene){
        .seen = {.sight = {0.0f, 0.0f, 0.0f, 1.0f},
                 .width = width,
                 .height = height,
                 .options = s->visibility},
        .n_casting = viewer->n_casting,
        .radius = viewer->radius,
        .serial = viewer->serial,
        .silhouettes = s->silhouettes,
        .shadows = s->shadows,
        .along_surface = s->along_surface,
        .lit = s->lamp > 0.0,
        .n_further = s->n_lamps,
        .light_size_deg = s->light_size_deg,
        .shadow_size = s->shadow_size,
    };
    viewer_parts(viewer, s, &ret->seen);
    viewer_fit(viewer, &fitted, aspect);
    camera_matrix(&fitted, viewer->radius, viewer->reach, aspect, ret->seen.projection,
                  ret->seen.sight);
    direction_from_deg(s->light_theta_deg, s->light_phi_deg, ret->light);
    for (int k = 0; k < s->n_lamps; k++)
        ret->further[k] = lamp_placed(&s->lamps[k], viewer->radius);
    return relief_prepare(viewer->relief, ret, error);
}

static void begin(const struct gpu_target *target) {
    glBindFramebuffer(GL_FRAMEBUFFER, target->framebuffer);
    glViewport(0, 0, target->width, target->height);
    glDepthMask(GL_TRUE);
    glClearColor(0.0f, 0.0f, 0.0f, 0.0f);
    glClear(GL_DEPTH_BUFFER_BIT | GL_COLOR_BUFFER_BIT);
}

static gboolean draw_scene(Viewer *viewer, const struct viewer_settings *settings, int width,
                           int height, GError **error) {
    const struct viewer_settings lit = lamp_settings(settings), *s = &lit;
    struct relief_scene scene;
    if (!make_endless(viewer, s, error) ||
        !gpu_target_resize(&viewer->scene, width, height, GL_RGBA16F, TRUE, error) ||
        !look(viewer, s, width, height, &scene, error))
        return FALSE;
    begin(&viewer->scene);
    return draw_mesh(viewer, s->plain ? viewer->plain_program : 0, s, &scene, error) &&
           backdrop_draw(viewer->backdrop, s, viewer->relief, scene.seen.projection,
                         scene.seen.sight, error);
}

static void resolve(Viewer *viewer, const struct viewer_settings *s, int samples, guint framebuffer,
                    int width, int height) {
    guint program = viewer->resolve_program;
    glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
    glViewport(0, 0, width, height);
    glDisable(GL_DEPTH_TEST);
    glUseProgram(program);
    gpu_bind_texture(program, "drawn", 0, GL_TEXTURE_2D, viewer->scene.colour);
    glUniform1i(glGetUniformLocation(program, "samples"), samples);
    glUniform1f(glGetUniformLocation(program, "exposure"), (float)viewer_settings_exposure(s));
    gpu_fill_screen();
}

static gboolean draw_geometry(Viewer *viewer, const struct viewer_settings *settings,
                              enum viewer_geometry which, int width, int height, GError **error) {
    const struct viewer_settings lit = lamp_settings(settings), *s = &lit;
    const int kind = s->lamp > 0.0 || s->n_lamps == 0 ? GEOMETRY_FIRST
                     : s->shadows                     ? GEOMETRY_FURTHER_SHADOWS
                                                      : GEOMETRY_FURTHER;
    const guint program = geometry_program(viewer, kind, error);
    struct relief_scene scene;
    if (program == 0 || !make_endless(viewer, s, error) ||
        !gpu_target_resize(&viewer->geometry, width, height, GL_RGBA32F, TRUE, error) ||
        !look(viewer, s, width, height, &scene, error))
        return FALSE;
    begin(&viewer->geometry);
    glDisable(GL_BLEND);
    glDisable(GL_CULL_FACE);
    glUseProgram(program);
    glUniform1i(glGetUniformLocation(program, "which"), which);
    return draw_mesh(viewer, program, s, &scene, error);
}

void viewer_set_planned(Viewer *viewer, const struct planned_view *views, guint n) {
    hatching_set(viewer->hatching, views, n);
}

/* Returns the number of samples along a side of a pixel: s->samples, or fewer if the whole picture
 * would otherwise have more than MAX_SAMPLES samples. */
static int samples_of(const struct viewer_settings *s, int width, int height) {
    int samples = s->samples;
    while (samples > 1 && (gint64)width * height * samples * samples > MAX_SAMPLES)
        samples--;
    return samples;
}

gboolean viewer_draw(Viewer *viewer, const struct viewer_settings *s, guint framebuffer, int width,
                     int height, GError **error) {
    const int samples = samples_of(s, width, height);
    if (!viewer_settings_check(s, error) ||
        !draw_scene(viewer, s, width * samples, height * samples, error))
        return FALSE;
    resolve(viewer, s, samples, framebuffer, width, height);
    if (hatching_any(viewer->hatching)) {
        if (!draw_geometry(viewer, s, VIEWER_GEOMETRY_VIEW, width, height, error))
            return FALSE;
        hatching_draw(viewer->hatching, viewer->geometry.colour, framebuffer, width, height);
    }
    return gpu_check("drawing", error);
}

static float *read_floats(const struct gpu_target *target, GError **error) {
    g_autofree float *rgba = g_new(float, 4 * (gsize)target->width * target->height);
    glBindFramebuffer(GL_FRAMEBUFFER, target->framebuffer);
    glPixelStorei(GL_PACK_ALIGNMENT, 1);
    glReadPixels(0, 0, target->width, target->height, GL_RGBA, GL_FLOAT, rgba);
    if (!gpu_check("reading the picture", error))
        return NULL;
    gpu_flip_rows(rgba, 4 * sizeof(float) * (gsize)target->width, target->height);
    return g_steal_pointer(&rgba);
}

float *viewer_render_linear(Viewer *viewer, const struct viewer_settings *s, int width, int height,
                            GError **error) {
    if (!viewer_settings_check(s, error) || !draw_scene(viewer, s, width, height, error))
        return NULL;
    return read_floats(&viewer->scene, error);
}

float *viewer_render_light(Viewer *viewer, const struct viewer_settings *s, int width, int height,
                           GError **error) {
    const int samples = samples_of(s, width, height);
    g_autofree float *drawn =
        viewer_render_linear(viewer, s, width * samples, height * samples, error);
    if (drawn == NULL)
        return NULL;
    const float share = 1.0F / (float)(samples * samples),
                exposure = (float)viewer_settings_exposure(s);
    float *light = g_new0(float, 3 * (gsize)width * height);
    for (gsize j = 0; j < (gsize)height * samples; j++)
        for (gsize i = 0; i < (gsize)width * samples; i++) {
            const float *from = drawn + 4 * (j * width * samples + i);
            float *to = light + 3 * (j / samples * width + i / samples);
            for (int c = 0; c < 3; c++)
                to[c] += from[c] * share * (from[3] > 0.5F ? exposure : 1);
        }
    return light;
}

float *viewer_render_geometry(Viewer *viewer, const struct viewer_settings *s,
                              enum viewer_geometry which, int width, int height, GError **error) {
    if (!viewer_settings_check(s, error) || !draw_geometry(viewer, s, which, width, height, error))
        return NULL;
    return read_floats(&viewer->geometry, error);
}

float *viewer_render_flat(Viewer *viewer, const struct viewer_settings *s, const float to_view[3],
                          const float to_light[3], int width, int height, GError **error) {
    const struct viewer_material *m = &viewer->materials[0];
    struct viewer_settings alone = *s;
    alone.ambient = 0;
    const struct places_source repeated = {NULL, NULL};
    const guint program =
        programs_get(m->programs, PROGRAM_FLAT, m->material, &repeated, &alone, error);
    if (program == 0 ||
        !gpu_target_resize(&viewer->geometry, width, height, GL_RGBA32F, TRUE, error))
        return NULL;
    begin(&viewer->geometry);
    glDisable(GL_BLEND);
    glDisable(GL_DEPTH_TEST);
    glUseProgram(program);
    m->method->bind(m->material, program, &s->style);
    glUniform3fv(glGetUniformLocation(program, "to_view"), 1, to_view);
    glUniform3fv(glGetUniformLocation(program, "to_light"), 1, to_light);
    gpu_fill_screen();
    return read_floats(&viewer->geometry, error);
}

guint8 *viewer_resolve(Viewer *viewer, const struct viewer_settings *s, const float *linear,
                       int width, int height, GError **error) {
    int w = width * s->samples, h = height * s->samples;
    if (!viewer_settings_check(s, error) ||
        !gpu_target_resize(&viewer->scene, w, h, GL_RGBA16F, TRUE, error) ||
        !gpu_target_resize(&viewer->picture, width, height, GL_RGBA8, FALSE, error))
        return NULL;
    g_autofree float *rows = g_memdup2(linear, 4 * sizeof(float) * (gsize)w * h);
    gpu_flip_rows(rows, 4 * sizeof(float) * (gsize)w, h);
    glActiveTexture(GL_TEXTURE0);
    glBindTexture(GL_TEXTURE_2D, viewer->scene.colour);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1);
    glTexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, w, h, GL_RGBA, GL_FLOAT, rows);
    resolve(viewer, s, s->samples, viewer->picture.framebuffer, width, height);
    return gpu_target_read(&viewer->picture, error);
}

void viewer_finish(void) {
    glFinish();
}
