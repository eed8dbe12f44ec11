#include "viewer.h"

#include "backdrop.h"
#include "base/direction.h"
#include "camera.h"
#include "gl/gpu.h"
#include "gl/places.h"
#include "hatching.h"
#include "methods/eigenmaps_view.h"
#include "programs.h"
#include "relief/relief.h"
#include "shapes/mesh_shape.h"

#include <epoxy/gl.h>
#include <math.h>
#include <stddef.h>
#include <string.h>

#define WHITE       0.8 /* see exposure_ev */
#define MAX_SAMPLES (1 << 26)

#define ENDLESS_LOOKS 10 /* pictures of the sample by which hexagons are chosen */

const struct viewer_settings viewer_settings_default = {
    .camera_azimuth_deg = -90.0,
    .camera_elevation_deg = 40.0,
    .camera_fov_deg = 30.0,
    .light_theta_deg = 50.0,
    .light_phi_deg = 200.0,
    .exposure_ev = 0.7,
    .ambient = 0.05,
    .environment_lamps = VIEWER_MAX_LAMPS,
    .lamp = 1.0,
    .samples = 1,
    .visibility = {.layers = VISIBILITY_MAX_LAYERS},
    .shadow_size = 1024,
};

struct Viewer {
    const struct method *method;
    gpointer material;           /* of the method */
    Programs *programs;          /* of the method */
    IndexTexture *index;         /* NULL: none */
    struct index_map *index_map; /* the same on the CPU */
    Endless *endless;            /* of the material; NULL until a picture needs it */
    Relief *relief;
    Backdrop *backdrop;
    Hatching *hatching;
    guint plain_program, geometry_program, resolve_program;
    guint array, vertices, shapes, indices;
    guint n_indices, n_casting, serial;
    double radius, tiles_u, tiles_v; /* of the mesh */
    double reach;                    /* of the mesh and its floor */
    float *points;                   /* n_points × 3 */
    guint n_points;
    struct gpu_target scene, geometry, picture;
};

gboolean viewer_settings_check(const struct viewer_settings *s, GError **error) {
    const struct {
        const char *name;
        double value, low, high;
    } ranges[] = {
        {"camera azimuth", s->camera_azimuth_deg, -1e6, 1e6},
        {"camera elevation", s->camera_elevation_deg, -90.0, 90.0},
        {"camera distance", s->camera_distance, 0.0, 1000.0},
        {"camera pan", s->camera_pan[0], -1000.0, 1000.0},
        {"camera pan", s->camera_pan[1], -1000.0, 1000.0},
        {"camera field of view", s->camera_fov_deg, 1.0, 120.0},
        {"light theta", s->light_theta_deg, 0.0, 180.0},
        {"light phi", s->light_phi_deg, -1e6, 1e6},
        {"tiles", s->tiles_u, 0.0, 1000.0},
        {"tiles", s->tiles_v, 0.0, 1000.0},
        {"exposure", s->exposure_ev, -20.0, 20.0},
        {"ambient", s->ambient, 0.0, 100.0},
        {"lamp", s->lamp, 0.0, 100.0},
        {"lamps", s->n_lamps, 0.0, VIEWER_MAX_LAMPS},
        {"environment's turn", s->environment_turn_deg, -1e6, 1e6},
        {"environment's lamps", s->environment_lamps, 1.0, VIEWER_MAX_LAMPS},
        {"supersampling", s->samples, 1.0, 8.0},
        {"layers", s->visibility.layers, 1.0, VISIBILITY_MAX_LAYERS},
        {"shadow map", s->shadow_size, 16.0, 16384.0},
    };
    for (gsize k = 0; k < G_N_ELEMENTS(ranges); k++)
        if (!(ranges[k].value >= ranges[k].low && ranges[k].value <= ranges[k].high)) {
            g_set_error(error, G_OPTION_ERROR, G_OPTION_ERROR_BAD_VALUE,
                        "%s is %g, but must be %g … %g", ranges[k].name, ranges[k].value,
                        ranges[k].low, ranges[k].high);
            return FALSE;
        }
    return TRUE;
}

double viewer_exposure(const struct viewer_settings *s) {
    return WHITE * exp2(s->exposure_ev);
}

static void make_array(Viewer *viewer) {
    glGenVertexArrays(1, &viewer->array);
    glGenBuffers(1, &viewer->vertices);
    glGenBuffers(1, &viewer->shapes);
    glGenBuffers(1, &viewer->indices);
    glBindVertexArray(viewer->array);
    glBindBuffer(GL_ARRAY_BUFFER, viewer->vertices);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, viewer->indices);
    const struct {
        int n;
        gsize offset;
    } attributes[] = {{3, offsetof(struct vertex, position)},
                      {3, offsetof(struct vertex, normal)},
                      {4, offsetof(struct vertex, tangent)},
                      {2, offsetof(struct vertex, uv)}};
    const guint n = G_N_ELEMENTS(attributes);
    for (guint k = 0; k < n; k++)
        glVertexAttribPointer(k, attributes[k].n, GL_FLOAT, GL_FALSE, sizeof(struct vertex),
                              (const void *)attributes[k].offset);
    glBindBuffer(GL_ARRAY_BUFFER, viewer->shapes);
    glVertexAttribPointer(n, 2, GL_FLOAT, GL_FALSE, sizeof(struct vertex_shape), NULL);
    glVertexAttribPointer(n + 1, 3, GL_FLOAT, GL_FALSE, sizeof(struct vertex_shape),
                          (const void *)offsetof(struct vertex_shape, bend));
    for (guint k = 0; k < n + 2; k++)
        glEnableVertexAttribArray(k);
    glBindVertexArray(0);
}

Viewer *viewer_new(const struct eigenmaps *material, GError **error) {
    const char *const plain[] = {"mesh.vert", "frame.glsl", "plain.frag", NULL};
    const char *const geometry[] = {"mesh.vert",   "frame.glsl",    "visible.glsl",
                                    "shadow.glsl", "geometry.frag", NULL};
    const char *const resolve[] = {"screen.vert", "tone.glsl", "resolve.frag", NULL};
    g_autoptr(Viewer) viewer = g_new0(Viewer, 1);
    viewer->radius = viewer->reach = 1.0;
    if ((viewer->plain_program = gpu_program("", plain, error)) == 0 ||
        (viewer->geometry_program = gpu_program("", geometry, error)) == 0 ||
        (viewer->resolve_program = gpu_program("", resolve, error)) == 0 ||
        (viewer->relief = relief_new(error)) == NULL ||
        (viewer->backdrop = backdrop_new(error)) == NULL ||
        (viewer->hatching = hatching_new(error)) == NULL ||
        (material != NULL && !viewer_set_material(viewer, material, error)))
        return NULL;
    make_array(viewer);
    return g_steal_pointer(&viewer);
}

void viewer_free(Viewer *viewer) {
    if (viewer == NULL)
        return;
    if (viewer->method != NULL)
        viewer->method->free(viewer->material);
    programs_free(viewer->programs);
    index_texture_free(viewer->index);
    index_map_free(viewer->index_map);
    endless_free(viewer->endless);
    relief_free(viewer->relief);
    backdrop_free(viewer->backdrop);
    hatching_free(viewer->hatching);
    glDeleteProgram(viewer->plain_program);
    glDeleteProgram(viewer->geometry_program);
    glDeleteProgram(viewer->resolve_program);
    glDeleteVertexArrays(1, &viewer->array);
    glDeleteBuffers(1, &viewer->vertices);
    glDeleteBuffers(1, &viewer->shapes);
    glDeleteBuffers(1, &viewer->indices);
    gpu_target_clear(&viewer->scene);
    gpu_target_clear(&viewer->geometry);
    gpu_target_clear(&viewer->picture);
    g_free(viewer->points);
    g_free(viewer);
}

gboolean viewer_set_method(Viewer *viewer, const struct method *method, gpointer material,
                           GError **error) {
    if (viewer->method != method) {
        g_autoptr(Programs) programs = programs_new(method);
        const struct places_source repeated = {NULL, NULL};
        if (!programs_get(programs, PROGRAM_SURFACE, material, &repeated, &viewer_settings_default,
                          error))
            return FALSE;
        programs_free(viewer->programs);
        viewer->programs = g_steal_pointer(&programs);
    }
    if (viewer->method != NULL)
        viewer->method->free(viewer->material);
    viewer->method = method;
    viewer->material = material;
    if (viewer->endless != NULL)
        relief_forget(viewer->relief);
    g_clear_pointer(&viewer->endless, endless_free);
    return TRUE;
}

/* material: taken; NULL with an error. */
static gboolean viewer_take(Viewer *viewer, const struct method *method, gpointer material,
                            GError **error) {
    if (material == NULL || viewer_set_method(viewer, method, material, error))
        return material != NULL;
    method->free(material);
    return FALSE;
}

gboolean viewer_open(Viewer *viewer, const struct method *method, const char *path,
                     GError **error) {
    return viewer_take(viewer, method, method_open(method, path, error), error);
}

gboolean viewer_set_material(Viewer *viewer, const struct eigenmaps *material, GError **error) {
    return viewer_take(viewer, &method_eigenmaps, eigenmaps_view_new(material, error), error);
}

gboolean viewer_set_mdf(Viewer *viewer, const struct mdf_source *mdf, GError **error) {
    return relief_set_mdf(viewer->relief, mdf, error);
}

gboolean viewer_open_mdf(Viewer *viewer, const char *path, GError **error) {
    struct mdf_source *mdf = mdf_source_read(path, error);
    gboolean good = mdf != NULL && viewer_set_mdf(viewer, mdf, error);
    if (mdf != NULL && !good)
        g_prefix_error(error, "%s: ", path);
    mdf_source_free(mdf);
    return good;
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
    return map != NULL && viewer_set_index(viewer, map, error);
}

const struct index_map *viewer_index(const Viewer *viewer) {
    return viewer->index_map;
}

/* Of methods that look texels up. */
static struct places_source viewer_places(const Viewer *viewer, const struct viewer_settings *s) {
    if (viewer->method == NULL || viewer->method->product == NULL)
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
    return (struct viewer_memory){viewer->method ? viewer->method->bytes(viewer->material) : 0,
                                  relief_mdf_bytes(viewer->relief),
                                  index_texture_bytes(viewer->index)};
}

gboolean viewer_set_mesh(Viewer *viewer, const struct mesh *mesh, GError **error) {
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

/* Tiles of the mesh, if the settings leave them to it. */
static void viewer_find_tiles(const Viewer *viewer, const struct viewer_settings *s, float ret[2]) {
    double tiles[2] = {s->tiles_u, s->tiles_v};
    if (!(tiles[0] > 0.0 && tiles[1] > 0.0)) {
        tiles[0] = viewer->tiles_u;
        tiles[1] = viewer->tiles_v;
        if (viewer_places(viewer, s).index != NULL)
            viewer_whole_tiles(viewer, &tiles[0], &tiles[1]);
    }
    ret[0] = (float)tiles[0];
    ret[1] = (float)tiles[1];
}

/* Before a picture with hexagons: chooses their centres by how the sample looks under some views
 * and lights. */
static gboolean viewer_make_endless(Viewer *viewer, const struct viewer_settings *s,
                                    GError **error) {
    int size[2];
    if (!s->endless || s->plain || viewer->endless != NULL || viewer->method->texels == NULL ||
        !viewer->method->texels(viewer->material, size))
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
    const struct endless *endless = viewer_places(viewer, s).endless;
    float tiles[2];
    viewer_find_tiles(viewer, s, tiles);
    if (endless != NULL)
        endless_lattice_init(ret, endless, tiles[0], tiles[1]);
    return endless;
}

static void viewer_draw_mesh(Viewer *viewer, guint program, const struct viewer_settings *s,
                             const struct relief_scene *scene) {
    glUseProgram(program);
    viewer->method->bind(viewer->material, program, &s->style);
    relief_bind(viewer->relief, program);
    places_bind(&scene->seen.places, scene->seen.tiles, program);
    glUniformMatrix4fv(glGetUniformLocation(program, "projection"), 1, GL_FALSE,
                       scene->seen.projection);
    glUniform2fv(glGetUniformLocation(program, "tiles"), 1, scene->seen.tiles);
    glUniform3fv(glGetUniformLocation(program, "eye"), 1, scene->seen.sight);
    glUniform3fv(glGetUniformLocation(program, "light"), 1, scene->light);
    glUniform1f(glGetUniformLocation(program, "ambient_light"), s->ambient);
    programs_set_lamps(program, s);
    glDisable(GL_BLEND);
    glDisable(GL_CULL_FACE);
    glEnable(GL_DEPTH_TEST);
    glDepthFunc(GL_LESS);
    glDepthMask(GL_TRUE);
    glBindVertexArray(viewer->array);
    glDrawElements(GL_TRIANGLES, viewer->n_indices, GL_UNSIGNED_INT, NULL);
    glBindVertexArray(0);
}

/* Points the camera, and finds the parts of the relief that it and the lamps see. */
static gboolean viewer_look(const Viewer *viewer, const struct viewer_settings *s, int width,
                            int height, struct relief_scene *ret, GError **error) {
    struct viewer_settings fitted = *s;
    const double aspect = (double)width / height;
    *ret = (struct relief_scene){
        .seen = {.places = viewer_places(viewer, s),
                 .array = viewer->array,
                 .n_indices = viewer->n_indices,
                 .sight = {0.0f, 0.0f, 0.0f, 1.0f},
                 .width = width,
                 .height = height,
                 .options = s->visibility},
        .n_casting = viewer->n_casting,
        .radius = viewer->radius,
        .serial = viewer->serial,
        .silhouettes = s->silhouettes,
        .shadows = s->shadows,
        .lit = s->lamp > 0.0,
        .n_further = s->n_lamps,
        .shadow_size = s->shadow_size,
    };
    viewer_find_tiles(viewer, s, ret->seen.tiles);
    viewer_fit(viewer, &fitted, aspect);
    camera_matrix(&fitted, viewer->radius, viewer->reach, aspect, ret->seen.projection,
                  ret->seen.sight);
    direction_from_deg(s->light_theta_deg, s->light_phi_deg, ret->light);
    for (int k = 0; k < s->n_lamps; k++)
        direction_from_deg(s->lamps[k].theta_deg, s->lamps[k].phi_deg, ret->further[k]);
    return relief_prepare(viewer->relief, ret, error);
}

static void viewer_begin(const struct gpu_target *target) {
    glBindFramebuffer(GL_FRAMEBUFFER, target->framebuffer);
    glViewport(0, 0, target->width, target->height);
    glDepthMask(GL_TRUE);
    glClearColor(0.0f, 0.0f, 0.0f, 0.0f);
    glClear(GL_DEPTH_BUFFER_BIT | GL_COLOR_BUFFER_BIT);
}

static gboolean viewer_draw_scene(Viewer *viewer, const struct viewer_settings *s, int width,
                                  int height, GError **error) {
    const enum program_kind kind = s->silhouettes || s->shadows ? PROGRAM_RELIEF : PROGRAM_SURFACE;
    if (!viewer_make_endless(viewer, s, error))
        return FALSE;
    const struct places_source places = viewer_places(viewer, s);
    const guint program =
        s->plain ? viewer->plain_program
                 : programs_get(viewer->programs, kind, viewer->material, &places, s, error);
    struct relief_scene scene;
    if (program == 0 ||
        !gpu_target_resize(&viewer->scene, width, height, GL_RGBA16F, TRUE, error) ||
        !viewer_look(viewer, s, width, height, &scene, error))
        return FALSE;
    viewer_begin(&viewer->scene);
    viewer_draw_mesh(viewer, program, s, &scene);
    return backdrop_draw(viewer->backdrop, s, viewer->relief, scene.seen.projection,
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
    glUniform1f(glGetUniformLocation(program, "exposure"), (float)viewer_exposure(s));
    gpu_fill_screen();
}

static gboolean draw_geometry(Viewer *viewer, const struct viewer_settings *s,
                              enum viewer_geometry which, int width, int height, GError **error) {
    struct relief_scene scene;
    if (!viewer_make_endless(viewer, s, error) ||
        !gpu_target_resize(&viewer->geometry, width, height, GL_RGBA32F, TRUE, error) ||
        !viewer_look(viewer, s, width, height, &scene, error))
        return FALSE;
    viewer_begin(&viewer->geometry);
    glDisable(GL_BLEND);
    glDisable(GL_CULL_FACE);
    glUseProgram(viewer->geometry_program);
    glUniform1i(glGetUniformLocation(viewer->geometry_program, "which"), which);
    viewer_draw_mesh(viewer, viewer->geometry_program, s, &scene);
    return TRUE;
}

void viewer_set_planned(Viewer *viewer, const struct planned_view *views, guint n) {
    hatching_set(viewer->hatching, views, n);
}

/* Samples along a side of a pixel: fewer in a very large picture. */
static int viewer_samples_of(const struct viewer_settings *s, int width, int height) {
    int samples = s->samples;
    while (samples > 1 && (gint64)width * height * samples * samples > MAX_SAMPLES)
        samples--;
    return samples;
}

gboolean viewer_draw(Viewer *viewer, const struct viewer_settings *s, guint framebuffer, int width,
                     int height, GError **error) {
    const int samples = viewer_samples_of(s, width, height);
    if (!viewer_settings_check(s, error) ||
        !viewer_draw_scene(viewer, s, width * samples, height * samples, error))
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

guint8 *viewer_render(Viewer *viewer, const struct viewer_settings *s, int width, int height,
                      GError **error) {
    if (!gpu_target_resize(&viewer->picture, width, height, GL_RGBA8, FALSE, error) ||
        !viewer_draw(viewer, s, viewer->picture.framebuffer, width, height, error))
        return NULL;
    return gpu_target_read(&viewer->picture, error);
}

float *viewer_render_linear(Viewer *viewer, const struct viewer_settings *s, int width, int height,
                            GError **error) {
    if (!viewer_settings_check(s, error) || !viewer_draw_scene(viewer, s, width, height, error))
        return NULL;
    return read_floats(&viewer->scene, error);
}

float *viewer_render_light(Viewer *viewer, const struct viewer_settings *s, int width, int height,
                           GError **error) {
    const int samples = viewer_samples_of(s, width, height);
    g_autofree float *drawn =
        viewer_render_linear(viewer, s, width * samples, height * samples, error);
    if (drawn == NULL)
        return NULL;
    const float share = 1.0F / (float)(samples * samples), exposure = (float)viewer_exposure(s);
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
    struct viewer_settings alone = *s;
    alone.ambient = 0;
    const struct places_source repeated = {NULL, NULL};
    const guint program =
        programs_get(viewer->programs, PROGRAM_FLAT, viewer->material, &repeated, &alone, error);
    if (program == 0 ||
        !gpu_target_resize(&viewer->geometry, width, height, GL_RGBA32F, TRUE, error))
        return NULL;
    viewer_begin(&viewer->geometry);
    glDisable(GL_BLEND);
    glDisable(GL_DEPTH_TEST);
    glUseProgram(program);
    viewer->method->bind(viewer->material, program, &s->style);
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
