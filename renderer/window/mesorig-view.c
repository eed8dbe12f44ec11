/* Shows a material on a shape: in a window, or as PNG or EXR files without a window. See
 * mesorig-view(1). */
#include "base/json.h"
#include "base/output_file.h"
#include "base/program.h"
#include "codecs/mdf_codecs/mdf_source.h"
#include "drawing/gl/gpu.h"
#include "live.h"
#include "notice.h"
#include "scene/environment.h"
#include "scene/measured.h"
#include "scene/picture.h"
#include "scene/reference.h"
#include "scene_files.h"
#include "series.h"
#include "snapshot.h"
#include "viewer_options.h"
#include "window.h"

#include <stdio.h>
#include <string.h>
#include <unistd.h>

/* Everything that is needed to make pictures, and the results. */
struct studio {
    const struct viewer_options *o;
    const char *material; /* path */
    const struct mesh *mesh;
    struct environment *environment; /* or NULL */
    Viewer *viewer, *second;         /* `second` draws o->second, or is NULL */
    Compose *compose;
    /* References for the materials of the viewer. The element of the main material may be NULL. If
     * n_references is 0, the pictures are those of the methods. */
    Reference *references[VIEWER_MAX_MATERIALS];
    int n_references;
    guint8 *sheet; /* picture with all frames in o->sheet columns; NULL if each frame is a file */
    struct window_result drawn;
    GPtrArray *files;         /* paths of written files */
    int n_replaced;           /* number of these files that replaced an existing one */
    double error;             /* error of the last frame against its reference */
    int n_views, n_planned;   /* numbers of measured views and of planned views of a live session */
    struct measured measured; /* result of --measured */
};

/* Returns the path of a frame for --render OUT.png. If there are several frames, the paths are
 * OUT_0000.png and so on. For a series, a path contains the percentage, such as OUT_020.png. */
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

static void studio_add(struct studio *studio, const char *path, const OutputFile *to) {
    g_ptr_array_add(studio->files, g_strdup(path));
    studio->n_replaced += output_file_note(to) != NULL;
}

/* Fails if one of the pictures must not be replaced. This is checked before a picture is drawn. */
static gboolean viewer_main_check_outputs(const struct viewer_options *o, GError **error) {
    const int n = o->sheet > 0 ? 1 : MAX(1, o->n_series > 0 ? o->n_series : o->frames);
    for (int k = 0; o->render != NULL && k < n; k++) {
        g_autofree char *path = frame_path(o, k);
        if (!output_file_check(path, PICTURE_KIND, o->force, error))
            return FALSE;
    }
    return o->screenshot == NULL || output_file_check(o->screenshot, PICTURE_KIND, o->force, error);
}

/* Writes a picture, either rgb or light. The other of the two must be NULL. */
static gboolean studio_write(struct studio *studio, const char *path,
                             const struct viewer_settings *s, const guint8 *rgb, const float *light,
                             int width, int height, GError **error) {
    const struct viewer_options *o = studio->o;
    const struct snapshot snapshot = {.material = studio->material,
                                      .shape = o->shape,
                                      .first = o->method,
                                      .second = o->second,
                                      .how = &o->compose,
                                      .reference = o->reference,
                                      .settings = s,
                                      .options = o,
                                      .n_views = studio->n_views,
                                      .n_planned = studio->n_planned};
    g_autoptr(OutputFile) to = output_file_new(path, PICTURE_KIND, o->force, error);
    const char *written = to != NULL ? output_file_path(to, error) : NULL;
    if (written == NULL ||
        !output_file_end(to, snapshot_write(written, &snapshot, rgb, light, width, height, error),
                         error))
        return FALSE;
    studio_add(studio, path, to);
    return TRUE;
}

static gboolean render_frame(struct studio *studio, int frame, const struct viewer_settings *s,
                             GError **error) {
    const struct viewer_options *o = studio->o;
    const gint64 from = g_get_monotonic_time();
    const gboolean linear = viewer_options_light(o);
    g_autofree char *path = frame_path(o, frame);
    g_autofree float *light =
        linear ? viewer_render_light(studio->viewer, s, o->width, o->height, error) : NULL;
    g_autofree guint8 *rgb =
        linear ? NULL
        : studio->n_references > 0
            ? reference_render_scene(studio->references, studio->n_references, studio->viewer, s,
                                     o->width, o->height, &studio->error, error)
            : compose_render(studio->compose, studio->viewer, studio->second, &o->compose, s,
                             o->width, o->height, error);
    if (light == NULL && rgb == NULL)
        return FALSE;
    studio->drawn.seconds += (g_get_monotonic_time() - from) * 1e-6;
    studio->drawn.n_frames++;
    if (studio->sheet == NULL || rgb == NULL)
        return studio_write(studio, path, s, rgb, light, o->width, o->height, error);
    const gsize row = 3 * (gsize)o->width;
    guint8 *to =
        studio->sheet + frame / o->sheet * o->height * row * o->sheet + frame % o->sheet * row;
    for (int j = 0; j < o->height; j++)
        memcpy(to + j * row * o->sheet, rgb + j * row, row);
    return TRUE;
}

/* Opens eigen-maps of the measured views of a session. Sets the stripes that mark missing views. */
static gboolean open_live(struct studio *studio, Viewer *viewer, GError **error) {
    const char *session = studio->o->argument;
    struct eigenmaps *maps = live_eigenmaps(session, &studio->n_views, error);
    const gboolean good = maps != NULL && viewer_set_material(viewer, maps, error);
    eigenmaps_free(maps);
    g_autoptr(GArray) planned = good ? live_views(session, NULL) : NULL;
    if (planned != NULL) { /* otherwise the session has a BTF and no plan */
        viewer_set_planned(viewer, (const struct planned_view *)(const void *)planned->data,
                           planned->len);
        studio->n_planned = (int)planned->len;
    }
    return good;
}

static gboolean render_frames(struct studio *studio, GError **error) {
    const struct viewer_options *o = studio->o;
    const int rows = viewer_options_sheet_rows(o);
    struct viewer_settings fitted = o->settings;
    fitted.tiles_u = studio->mesh->tiles_u;
    fitted.tiles_v = studio->mesh->tiles_v;
    g_autofree guint8 *sheet =
        o->sheet > 0 ? g_malloc0(3 * (gsize)o->width * o->height * o->sheet * rows) : NULL;
    studio->sheet = sheet;
    /* Fits the camera once, so that the shape keeps its size in all frames. */
    viewer_fit(studio->viewer, &fitted, (double)o->width / o->height);
    for (int k = 0; k < o->n_series; k++) {
        g_autoptr(GArray) views = series_wait(o->argument, o->series[k], o->wait_s, error);
        if (views == NULL || !open_live(studio, studio->viewer, error) ||
            !render_frame(studio, k, &fitted, error))
            return FALSE;
        if (!o->json)
            g_print("%d of %d views\n", studio->n_views, studio->n_planned);
    }
    for (int k = 0; o->n_series == 0 && k < MAX(o->frames, 1); k++) {
        struct viewer_settings s = fitted;
        double turned = o->frames > 0 ? 360.0 * k / o->frames : 0.0;
        s.light_phi_deg += o->light_turn ? turned : 0.0;
        s.camera_azimuth_deg += o->camera_turn ? turned : 0.0;
        if (!render_frame(studio, k, &s, error))
            return FALSE;
    }
    return sheet == NULL || studio_write(studio, o->render, &fitted, sheet, NULL,
                                         o->width * o->sheet, o->height * rows, error);
}

static gboolean render_measured(struct studio *studio, GError **error) {
    const struct viewer_options *o = studio->o;
    struct measured *m = &studio->measured;
    if (!measured_compare(studio->references[0], studio->viewer, &o->settings, o->width, m, error))
        return FALSE;
    studio->error = m->error;
    studio->drawn.n_frames = 1;
    const locale_t before = picture_numbers_begin();
    g_autofree char *frame = g_strdup_printf(
        "view %d: theta %g deg, phi %g deg; light %d: theta %g deg, phi %g deg", m->view,
        m->view_theta_deg, m->view_phi_deg, m->light, m->light_theta_deg, m->light_phi_deg);
    picture_numbers_end(before);
    const char *texts[] = {
        "Software", "mesorig-view " MESORIG_VERSION, "Frame", frame, "Source", o->method->title,
        NULL};
    g_autoptr(OutputFile) to = output_file_new(o->render, PICTURE_KIND, o->force, error);
    const char *path = to != NULL ? output_file_path(to, error) : NULL;
    if (path == NULL ||
        !output_file_end(to, picture_write_png(path, m->rgb, m->width, m->height, texts, error),
                         error))
        return FALSE;
    studio_add(studio, o->render, to);
    return TRUE;
}

static Viewer *open_viewer(struct studio *studio, const struct method *method, GError **error) {
    const struct viewer_options *o = studio->o;
    g_autofree char *path = viewer_options_path(o, method);
    g_autoptr(Viewer) viewer = viewer_new(NULL, error);
    if (viewer == NULL)
        return NULL;
    if (o->n_series > 0) { /* the viewer needs a material from the start */
        g_autoptr(GArray) views = series_wait(o->argument, o->series[0], o->wait_s, error);
        if (views == NULL)
            return NULL;
    }
    if (!(o->live ? open_live(studio, viewer, error) : viewer_open(viewer, method, path, error)) ||
        (o->settings.silhouettes && (o->n_bindings == 0 || o->argument != NULL) &&
         !viewer_open_mdf(viewer, o->mdf_path, error)) ||
        !scene_files_open(o, method, o->settings.silhouettes, viewer, error) ||
        (o->index_path != NULL && !viewer_open_index(viewer, o->index_path, error)) ||
        (o->settings.backdrop && !viewer_set_environment(viewer, studio->environment, error)) ||
        !viewer_set_mesh(viewer, studio->mesh, error))
        return NULL;
    return g_steal_pointer(&viewer);
}

static gboolean open_references(struct studio *studio, GError **error) {
    const struct viewer_options *o = studio->o;
    studio->n_references = o->n_bindings + 1;
    for (int k = 0; k <= o->n_bindings; k++) {
        const char *path = k > 0 ? o->bindings[k - 1].path : o->argument;
        if (path == NULL)
            continue;
        g_autofree char *mdf = g_build_filename(path, "products", "mdf.exr", NULL);
        if ((studio->references[k] = scene_files_reference(path, error)) == NULL ||
            (o->settings.along_surface &&
             !reference_move_along_surface(studio->references[k], mdf, error)))
            return FALSE;
    }
    return TRUE;
}

static gboolean viewer_main_render(struct studio *studio, GError **error) {
    const struct viewer_options *o = studio->o;
    const struct scene_options scene = {o->settings.tiles_u, o->settings.tiles_v, o->upward,
                                        o->floor};
    g_autoptr(Mesh) mesh = scene_files_mesh(o, o->shape, &scene, error);
    g_autoptr(Gpu) gpu = mesh != NULL ? gpu_new_headless(error) : NULL;
    g_autoptr(Compose) compose = gpu != NULL ? compose_new(error) : NULL;
    studio->mesh = mesh;
    g_autoptr(Viewer) viewer = compose != NULL ? open_viewer(studio, o->method, error) : NULL;
    g_autoptr(Viewer) second =
        viewer != NULL && o->second != NULL ? open_viewer(studio, o->second, error) : NULL;
    if (viewer == NULL && o->reference && o->argument != NULL)
        g_prefix_error(
            error, "--reference compares with a picture drawn by --method %s: ", o->method->name);
    if (viewer == NULL || (o->second != NULL && second == NULL))
        return FALSE;
    studio->drawn.renderer = g_strdup(gpu_renderer());
    studio->drawn.memory = viewer_memory(viewer);
    if ((o->reference || o->measured) && !open_references(studio, error))
        return FALSE;
    studio->viewer = viewer;
    studio->second = second;
    studio->compose = compose;
    return o->measured ? render_measured(studio, error) : render_frames(studio, error);
}

/* Adds a number to the report. format is a printf() format for the value. */
static void report_number(GString *json, const char *name, const char *format, double value) {
    char text[G_ASCII_DTOSTR_BUF_SIZE];
    g_ascii_formatd(text, sizeof text, format, value);
    g_string_append_printf(json, ", \"%s\": %s", name, text);
}

static void viewer_main_report(const struct studio *studio) {
    const struct viewer_options *o = studio->o;
    const struct window_result *drawn = &studio->drawn;
    g_autoptr(GString) json = g_string_new("{\"material\": ");
    json_append_string(json, studio->material);
    g_string_append(json, ", \"shape\": ");
    json_append_string(json, o->shape);
    g_string_append(json, ", \"renderer\": ");
    json_append_string(json, drawn->renderer);
    g_string_append_printf(json, ", \"width\": %d, \"height\": %d, \"frames\": %d", o->width,
                           o->height, drawn->n_frames);
    report_number(json, "seconds", "%.4f", drawn->seconds);
    g_string_append(json, ", \"files\": [");
    for (guint k = 0; k < studio->files->len; k++) {
        g_string_append(json, k > 0 ? ", " : "");
        json_append_string(json, studio->files->pdata[k]);
    }
    g_string_append_printf(json, "], \"replaced\": %d", studio->n_replaced);
    g_string_append_printf(json,
                           ", \"gpu_bytes\": %" G_GINT64_FORMAT
                           ", \"gpu_bytes_mdf\": %" G_GINT64_FORMAT
                           ", \"gpu_bytes_index\": %" G_GINT64_FORMAT,
                           drawn->memory.material, drawn->memory.mdf, drawn->memory.index);
    if (o->render == NULL)
        report_number(json, "first_picture_seconds", "%.3f", drawn->first_seconds);
    if (o->live)
        g_string_append_printf(json, ", \"views\": %d", studio->n_views);
    if (o->measured) {
        report_number(json, "view_theta_deg", "%.3f", studio->measured.view_theta_deg);
        report_number(json, "view_phi_deg", "%.3f", studio->measured.view_phi_deg);
        report_number(json, "light_theta_deg", "%.3f", studio->measured.light_theta_deg);
        report_number(json, "light_phi_deg", "%.3f", studio->measured.light_phi_deg);
    }
    if (o->reference || o->measured)
        report_number(json, "relative_error", "%.4f", studio->error);
    g_print("%s}\n", json->str);
}

/* Prints the written files. With --measured, also prints which measured picture was compared. */
static void viewer_main_tell(const struct studio *studio) {
    const GPtrArray *files = studio->files;
    const struct measured *m = &studio->measured;
    if (files->len > 1)
        g_print("%u pictures, to %s: %s on %s\n", files->len,
                (const char *)files->pdata[files->len - 1], studio->material, studio->o->shape);
    else if (files->len == 1 && !studio->o->measured)
        g_print("%s: %s on %s\n", (const char *)files->pdata[0], studio->material,
                studio->o->shape);
    else if (files->len == 1)
        g_print(
            "%s: from left to right the measured picture, the drawn picture, and four times their "
            "difference; view %d at %.1f° %.1f°, light %d at %.1f° %.1f°, relative error %.2f %%\n",
            (const char *)files->pdata[0], m->view, m->view_theta_deg, m->view_phi_deg, m->light,
            m->light_theta_deg, m->light_phi_deg, 100 * studio->error);
    if (studio->n_replaced > 0)
        g_print("%d of %u %s an existing file\n", studio->n_replaced, files->len,
                studio->n_replaced == 1 ? "replaces" : "replace");
}

static int viewer_main_run(struct viewer_options *o) {
    g_autoptr(GError) error = NULL;
    g_autofree char *material = o->n_bindings > 0 && o->argument == NULL
                                    ? g_strdup("the scene's materials")
                                    : viewer_options_path(o, o->method);
    g_autofree char *folder = g_path_get_dirname(material);
    g_autoptr(GPtrArray) files = g_ptr_array_new_with_free_func(g_free);
    struct studio studio = {.o = o, .material = material, .files = files};
    gboolean good = TRUE;
    if (o->shape == NULL)
        o->shape = g_strdup("torus");
    /* The MDF of a material is in the same folder. */
    o->mdf_path = o->mdf != NULL ? g_strdup(o->mdf) : g_build_filename(folder, "mdf.exr", NULL);
    good = viewer_main_check_outputs(o, &error) &&
           (o->mdf == NULL || mdf_source_fits(o->mdf, material, &error));
    o->index_path = viewer_options_index(o);
    if (good && o->render != NULL && o->environment != NULL)
        good = (studio.environment = environment_open(o->environment, &error)) != NULL &&
               environment_light(studio.environment, &o->settings, &error);
    if (good && o->render != NULL) {
        good = viewer_main_render(&studio, &error);
    } else if (good && (good = window_run(o, &studio.drawn, &error))) {
        if (!o->json)
            g_print("first picture after %.2f s\n", studio.drawn.first_seconds);
        if (o->screenshot != NULL)
            g_ptr_array_add(files, g_strdup(o->screenshot));
    }
    environment_free(studio.environment);
    if (!good)
        g_printerr("mesorig-view: %s\n", error->message);
    if (!good && o->render == NULL && o->close_after == 0 && !isatty(STDERR_FILENO))
        /* Without a terminal, nobody sees stderr. */
        notice_show("The viewer opens no window", error->message);
    if (good && o->json)
        viewer_main_report(&studio);
    else if (o->render != NULL)
        viewer_main_tell(&studio);
    measured_clear(&studio.measured);
    for (int k = 0; k < studio.n_references; k++)
        reference_free(studio.references[k]);
    g_free(studio.drawn.renderer);
    return good ? 0 : 1;
}

int main(int argc, char **argv) {
    struct viewer_options o;
    viewer_options_init(&o);
    o.started_us = g_get_monotonic_time();
    g_autoptr(GError) error = NULL;
    g_autofree GOptionEntry *table = viewer_options_entries(&o);
    const struct command_line command_line = {
        .name = "mesorig-view",
        .summary = "Shows a measured material.",
        .description =
            "MATERIAL is the directory of a processed session, or a file that mesorig "
            "process or mesorig compress made. Without MATERIAL, woven fabric is shown.\n",
        .options = table,
        .data = &o,
    };
    program_parse(&command_line, &argc, &argv);
    const int status = viewer_options_check(&o, &error)
                           ? viewer_main_run(&o)
                           : program_usage(&command_line, "%s", error->message);
    viewer_options_clear(&o);
    return status;
}
