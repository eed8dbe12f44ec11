/* Shows a material on a shape: in a window, or as PNG files without one. See mesorig-view(1). */
#include "base/json.h"
#include "gl/gpu.h"
#include "live.h"
#include "scene/environment.h"
#include "scene/measured.h"
#include "scene/picture.h"
#include "scene/reference.h"
#include "series.h"
#include "snapshot.h"
#include "viewer_options.h"
#include "window.h"

#include <locale.h>
#include <stdio.h>
#include <string.h>

struct rendered {
    int n_frames;
    double seconds;
    char *renderer;
    GPtrArray *files;
    double error;         /* of the last frame against its reference */
    double first_seconds; /* from the start to a window's first picture */
    int n_views;          /* of a live session */
    int n_planned;
    struct measured measured;
    struct viewer_memory memory;
};

/* OUT.png becomes OUT_0000.png, … if there are more than one; of a series OUT_020.png, … */
static char *frame_path(const struct viewer_options *o, int frame) {
    if ((o->frames == 0 && o->n_series == 0) || o->sheet > 0)
        return g_strdup(o->render);
    gsize length = strlen(o->render);
    const char *end = viewer_options_light(o) ? ".exr" : ".png";
    gboolean has = length > 4 && g_ascii_strcasecmp(o->render + length - 4, end) == 0;
    return g_strdup_printf("%.*s_%0*d%s", (int)(has ? length - 4 : length), o->render,
                           o->n_series > 0 ? 3 : 4, o->n_series > 0 ? o->series[frame] : frame,
                           end);
}

static struct snapshot snapshot_of(const struct viewer_options *o, const char *material,
                                   const struct viewer_settings *s, const struct rendered *done) {
    return (struct snapshot){.material = material,
                             .shape = o->shape,
                             .first = o->method,
                             .second = o->second,
                             .how = &o->compose,
                             .reference = o->reference,
                             .settings = s,
                             .environment = o->environment,
                             .mdf = o->mdf_path,
                             .normal_map = o->normal_map,
                             .floor = o->floor,
                             .n_views = done->n_views,
                             .n_planned = done->n_planned};
}

static gboolean viewer_main_write_frame(const struct viewer_options *o, const char *material,
                                        const char *path, const struct viewer_settings *s,
                                        const struct rendered *done, const guint8 *rgb, int width,
                                        int height, GError **error) {
    const struct snapshot snapshot = snapshot_of(o, material, s, done);
    return snapshot_write(path, &snapshot, rgb, width, height, error);
}

/* Into its place on a sheet of o->sheet columns. */
static void put_on_sheet(const struct viewer_options *o, int frame, const guint8 *rgb,
                         guint8 *sheet) {
    gsize row = 3 * (gsize)o->width;
    guint8 *to = sheet + frame / o->sheet * o->height * row * o->sheet + frame % o->sheet * row;
    for (int j = 0; j < o->height; j++)
        memcpy(to + j * row * o->sheet, rgb + j * row, row);
}

static char *btf_path(const struct viewer_options *o) {
    return (o->reference || o->measured) && o->rest
               ? g_build_filename(o->rest[0], "products", "btf", NULL)
               : NULL;
}

/* What frames are made with. */
struct studio {
    const char *material;
    Viewer *viewer, *second;
    Compose *compose;
    Reference *reference; /* NULL: from eigen-maps */
    guint8 *sheet;        /* NULL: a file a frame */
};

static gboolean render_light(const struct viewer_options *o, const struct studio *studio,
                             const char *path, const struct viewer_settings *s,
                             struct rendered *ret, GError **error) {
    const gint64 from = g_get_monotonic_time();
    g_autofree float *light = viewer_render_light(studio->viewer, s, o->width, o->height, error);
    const struct snapshot snapshot = snapshot_of(o, studio->material, s, ret);
    ret->seconds += (g_get_monotonic_time() - from) * 1e-6;
    return light != NULL &&
           snapshot_write_light(path, &snapshot, light, o->width, o->height, error);
}

static gboolean render_shown(const struct viewer_options *o, const struct studio *studio, int frame,
                             const char *path, const struct viewer_settings *s,
                             struct rendered *ret, GError **error) {
    const gint64 from = g_get_monotonic_time();
    g_autofree guint8 *rgb = studio->reference != NULL
                                 ? reference_render(studio->reference, studio->viewer, s, o->width,
                                                    o->height, &ret->error, error)
                                 : compose_render(studio->compose, studio->viewer, studio->second,
                                                  &o->compose, s, o->width, o->height, error);
    if (rgb == NULL)
        return FALSE;
    ret->seconds += (g_get_monotonic_time() - from) * 1e-6;
    if (studio->sheet == NULL)
        return viewer_main_write_frame(o, studio->material, path, s, ret, rgb, o->width, o->height,
                                       error);
    put_on_sheet(o, frame, rgb, studio->sheet);
    return TRUE;
}

static gboolean render_frame(const struct viewer_options *o, const struct studio *studio, int frame,
                             const struct viewer_settings *s, struct rendered *ret,
                             GError **error) {
    g_autofree char *path = frame_path(o, frame);
    if (!(viewer_options_light(o) ? render_light(o, studio, path, s, ret, error)
                                  : render_shown(o, studio, frame, path, s, ret, error)))
        return FALSE;
    ret->n_frames++;
    if (studio->sheet == NULL)
        g_ptr_array_add(ret->files, g_steal_pointer(&path));
    return TRUE;
}

/* Eigen-maps of what there is of a session, and stripes where views are missing. */
static gboolean open_live(const struct viewer_options *o, Viewer *viewer, struct rendered *ret,
                          GError **error) {
    struct eigenmaps *maps = live_eigenmaps(o->rest[0], &ret->n_views, error);
    const gboolean good = maps != NULL && viewer_set_material(viewer, maps, error);
    eigenmaps_free(maps);
    g_autoptr(GArray) planned = good ? live_views(o->rest[0], NULL) : NULL;
    if (planned != NULL) { /* else it has a BTF and no plan */
        viewer_set_planned(viewer, (const struct planned_view *)(const void *)planned->data,
                           planned->len);
        ret->n_planned = (int)planned->len;
    }
    return good;
}

static gboolean render_series(const struct viewer_options *o, const struct studio *studio,
                              const struct viewer_settings *s, struct rendered *ret,
                              GError **error) {
    for (int k = 0; k < o->n_series; k++) {
        g_autoptr(GArray) views = series_wait(o->rest[0], o->series[k], o->wait_s, error);
        if (views == NULL || !open_live(o, studio->viewer, ret, error) ||
            !render_frame(o, studio, k, s, ret, error))
            return FALSE;
        if (!o->json)
            g_print("%d of %d views\n", ret->n_views, ret->n_planned);
    }
    return TRUE;
}

static gboolean render_turn(const struct viewer_options *o, const struct studio *studio,
                            const struct viewer_settings *fitted, struct rendered *ret,
                            GError **error) {
    for (int k = 0; k < MAX(o->frames, 1); k++) {
        struct viewer_settings s = *fitted;
        double turned = o->frames > 0 ? 360.0 * k / o->frames : 0.0;
        s.light_phi_deg += o->light_turn ? turned : 0.0;
        s.camera_azimuth_deg += o->camera_turn ? turned : 0.0;
        if (!render_frame(o, studio, k, &s, ret, error))
            return FALSE;
    }
    return TRUE;
}

static gboolean render_frames(const struct viewer_options *o, struct studio *studio,
                              const struct viewer_settings *start, struct rendered *ret,
                              GError **error) {
    struct viewer_settings fitted = *start;
    gsize size = 3 * (gsize)o->width * o->height;
    g_autofree guint8 *sheet =
        o->sheet > 0 ? g_malloc0(size * o->sheet * viewer_options_sheet_rows(o)) : NULL;
    studio->sheet = sheet;
    /* Once, so that the shape keeps its size in all frames. */
    viewer_fit(studio->viewer, &fitted, (double)o->width / o->height);
    if (!(o->n_series > 0 ? render_series(o, studio, &fitted, ret, error)
                          : render_turn(o, studio, &fitted, ret, error)))
        return FALSE;
    if (sheet == NULL)
        return TRUE;
    g_ptr_array_add(ret->files, g_strdup(o->render));
    return viewer_main_write_frame(o, studio->material, o->render, &fitted, ret, sheet,
                                   o->width * o->sheet, o->height * viewer_options_sheet_rows(o),
                                   error);
}

/* Something is needed to open. */
static gboolean series_wait_first(const struct viewer_options *o, GError **error) {
    const char *session = o->rest != NULL ? o->rest[0] : "";
    g_autoptr(GArray) views = series_wait(session, o->series[0], o->wait_s, error);
    return views != NULL;
}

/* What a picture is of, beside the material. */
struct set {
    const struct mesh *mesh;
    const struct environment *environment; /* or NULL */
};

static Viewer *open_viewer(const struct viewer_options *o, const struct method *method,
                           const char *material, const struct set *set, struct rendered *ret,
                           GError **error) {
    g_autoptr(Viewer) viewer = viewer_new(NULL, error);
    if (viewer == NULL || !(o->n_series > 0 ? series_wait_first(o, error) : TRUE) ||
        !(o->live ? open_live(o, viewer, ret, error)
                  : viewer_open(viewer, method, material, error)) ||
        (o->settings.silhouettes && !viewer_open_mdf(viewer, o->mdf_path, error)) ||
        (o->settings.backdrop && !viewer_set_environment(viewer, set->environment, error)) ||
        !viewer_set_mesh(viewer, set->mesh, error))
        return NULL;
    return g_steal_pointer(&viewer);
}

static gboolean render_measured(const struct viewer_options *o, const struct studio *studio,
                                struct rendered *ret, GError **error) {
    struct measured *m = &ret->measured;
    if (!measured_compare(studio->reference, studio->viewer, &o->settings, o->width, m, error))
        return FALSE;
    ret->error = m->error;
    ret->n_frames = 1;
    const locale_t before = picture_numbers_begin();
    g_autofree char *frame = g_strdup_printf(
        "view %d: theta %g deg, phi %g deg; light %d: theta %g deg, phi %g deg", m->view,
        m->view_theta_deg, m->view_phi_deg, m->light, m->light_theta_deg, m->light_phi_deg);
    picture_numbers_end(before);
    const char *texts[] = {
        "Software", "mesorig-view " MESORIG_VERSION, "Frame", frame, "Source", o->method->title,
        NULL};
    g_ptr_array_add(ret->files, g_strdup(o->render));
    return picture_write_png(o->render, m->rgb, m->width, m->height, texts, error);
}

/* What the method opens. */
static char *viewer_main_path_of(const struct viewer_options *o, const struct method *method) {
    if (method->takes_normals && o->normal_map != NULL)
        return g_strdup(o->normal_map);
    const gboolean given = o->rest != NULL && o->rest[0] != NULL;
    return method_path(method, given && method->product != NULL ? o->rest[0] : method->name);
}

static gboolean render_set(const struct viewer_options *o, const char *material,
                           const struct set *set, struct rendered *ret, GError **error) {
    g_autoptr(Gpu) gpu = gpu_new_headless(error);
    g_autoptr(Compose) compose = gpu != NULL ? compose_new(error) : NULL;
    g_autoptr(Viewer) viewer =
        compose != NULL ? open_viewer(o, o->method, material, set, ret, error) : NULL;
    if (viewer == NULL)
        return FALSE;
    g_autofree char *other = o->second != NULL ? viewer_main_path_of(o, o->second) : NULL;
    g_autoptr(Viewer) second =
        o->second != NULL ? open_viewer(o, o->second, other, set, ret, error) : NULL;
    if (o->second != NULL && second == NULL)
        return FALSE;
    struct viewer_settings settings = o->settings;
    settings.tiles_u = set->mesh->tiles_u;
    settings.tiles_v = set->mesh->tiles_v;
    ret->renderer = g_strdup(gpu_renderer());
    ret->memory = viewer_memory(viewer);
    g_autofree char *btf = btf_path(o);
    g_autoptr(Reference) reference = btf != NULL ? reference_open(btf, error) : NULL;
    if (btf != NULL && reference == NULL)
        return FALSE;
    struct studio studio = {material, viewer, second, compose, reference, NULL};
    return o->measured ? render_measured(o, &studio, ret, error)
                       : render_frames(o, &studio, &settings, ret, error);
}

static gboolean viewer_main_render(const struct viewer_options *o, const char *material,
                                   const struct environment *environment, struct rendered *ret,
                                   GError **error) {
    const struct scene_options scene = {o->settings.tiles_u, o->settings.tiles_v, o->upward,
                                        o->floor};
    struct mesh *mesh = scene_make(o->shape, &scene, error);
    const struct set set = {mesh, environment};
    gboolean good = mesh != NULL && render_set(o, material, &set, ret, error);
    mesh_free(mesh);
    return good;
}

static gboolean viewer_main_show(const struct viewer_options *o,
                                 const struct environment *environment, struct rendered *ret,
                                 GError **error) {
    const struct window_options window = {
        .method = o->method,
        .second = o->second,
        .compose = o->compose,
        .argument = o->rest != NULL ? o->rest[0] : NULL,
        .mdf = o->mdf_path,
        .environment = environment,
        .environment_path = o->environment,
        .normal_map = o->normal_map,
        .shape = o->shape,
        .up = o->upward,
        .floor = o->floor,
        .width = o->width,
        .height = o->height,
        .close_after = o->close_after,
        .screenshot = o->screenshot,
        .with_panel = o->with_panel,
        .started_us = o->started_us,
        .settings = o->settings,
    };
    struct window_result result;
    gboolean good = window_run(&window, &result, error);
    ret->n_frames = result.n_frames;
    ret->seconds = result.seconds;
    ret->first_seconds = result.first_seconds;
    if (good && !o->json)
        g_print("first picture after %.2f s\n", result.first_seconds);
    ret->renderer = result.renderer;
    ret->memory = result.memory;
    if (good && o->screenshot != NULL)
        g_ptr_array_add(ret->files, g_strdup(o->screenshot));
    return good;
}

static void report_measured(GString *json, const struct measured *m) {
    const struct {
        const char *name;
        double value;
    } numbers[] = {{"view_theta_deg", m->view_theta_deg},
                   {"view_phi_deg", m->view_phi_deg},
                   {"light_theta_deg", m->light_theta_deg},
                   {"light_phi_deg", m->light_phi_deg}};
    for (gsize k = 0; k < G_N_ELEMENTS(numbers); k++) {
        char text[G_ASCII_DTOSTR_BUF_SIZE];
        g_ascii_formatd(text, sizeof text, "%.3f", numbers[k].value);
        g_string_append_printf(json, ", \"%s\": %s", numbers[k].name, text);
    }
}

static void viewer_main_report(const struct viewer_options *o, const char *material,
                               const struct rendered *done) {
    g_autoptr(GString) json = g_string_new("{\"material\": ");
    json_append_string(json, material);
    g_string_append(json, ", \"shape\": ");
    json_append_string(json, o->shape);
    g_string_append(json, ", \"renderer\": ");
    json_append_string(json, done->renderer);
    char seconds[G_ASCII_DTOSTR_BUF_SIZE];
    g_ascii_formatd(seconds, sizeof seconds, "%.4f", done->seconds);
    g_string_append_printf(json,
                           ", \"width\": %d, \"height\": %d, \"frames\": %d, \"seconds\": %s, "
                           "\"files\": [",
                           o->width, o->height, done->n_frames, seconds);
    for (guint k = 0; k < done->files->len; k++) {
        g_string_append(json, k > 0 ? ", " : "");
        json_append_string(json, done->files->pdata[k]);
    }
    g_string_append_c(json, ']');
    g_string_append_printf(
        json, ", \"gpu_bytes\": %" G_GINT64_FORMAT ", \"gpu_bytes_mdf\": %" G_GINT64_FORMAT,
        done->memory.material, done->memory.mdf);
    if (o->render == NULL) {
        g_ascii_formatd(seconds, sizeof seconds, "%.3f", done->first_seconds);
        g_string_append_printf(json, ", \"first_picture_seconds\": %s", seconds);
    }
    if (o->live)
        g_string_append_printf(json, ", \"views\": %d", done->n_views);
    if (o->measured)
        report_measured(json, &done->measured);
    if (o->reference || o->measured) {
        g_ascii_formatd(seconds, sizeof seconds, "%.4f", done->error);
        g_string_append_printf(json, ", \"relative_error\": %s", seconds);
    }
    g_print("%s}\n", json->str);
}

/* That of a material lies beside it. */
static char *mdf_path(const struct viewer_options *o, const char *material) {
    g_autofree char *folder = g_path_get_dirname(material);
    return o->mdf != NULL ? g_strdup(o->mdf) : g_build_filename(folder, "mdf.exr", NULL);
}

static int viewer_main_run(struct viewer_options *o) {
    g_autoptr(GError) error = NULL;
    g_autofree char *material = viewer_main_path_of(o, o->method);
    g_autoptr(GPtrArray) files = g_ptr_array_new_with_free_func(g_free);
    struct rendered done = {.files = files};
    if (o->shape == NULL)
        o->shape = g_strdup("torus");
    o->mdf_path = mdf_path(o, material);
    struct environment *environment =
        o->environment != NULL ? environment_read(o->environment, &error) : NULL;
    const gboolean lit =
        environment != NULL ? environment_light(environment, &o->settings, &error) : error == NULL;
    gboolean good =
        lit && (o->render != NULL ? viewer_main_render(o, material, environment, &done, &error)
                                  : viewer_main_show(o, environment, &done, &error));
    environment_free(environment);
    if (!good)
        g_printerr("mesorig-view: %s\n", error->message);
    else if (o->json)
        viewer_main_report(o, material, &done);
    measured_clear(&done.measured);
    g_free(done.renderer);
    return good ? 0 : 1;
}

int main(int argc, char **argv) {
    setlocale(LC_ALL, "");
    struct viewer_options o = {.settings = viewer_settings_default,
                               .started_us = g_get_monotonic_time()};
    g_autoptr(GError) error = NULL;
    g_autoptr(GOptionContext) context = g_option_context_new("– show a measured material");
    g_autofree GOptionEntry *table = viewer_options_entries(&o);
    GOptionGroup *group = g_option_group_new("", "", "", &o, NULL);
    g_option_group_add_entries(group, table);
    g_option_context_set_main_group(context, group);
    g_option_context_set_description(
        context,
        "MATERIAL is the directory of a processed session, or a file that mesorig process or "
        "mesorig compress made; without one, woven fabric is shown.\n");
    int status = 0;
    gboolean parsed = g_option_context_parse(context, &argc, &argv, &error);
    if (parsed && o.version) {
        g_print("mesorig-view %s\n", MESORIG_VERSION);
    } else if (!parsed || !viewer_options_check(&o, &error)) {
        g_printerr("mesorig-view: %s\nTry “mesorig-view --help”.\n", error->message);
        status = 2;
    } else {
        status = viewer_main_run(&o);
    }
    viewer_options_clear(&o);
    return status;
}
