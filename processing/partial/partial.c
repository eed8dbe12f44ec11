#include "partial.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

#include "calibration/calibration.h"
#include "frames/rectify.h"
#include "session/inputs.h"
#include "session/outputs.h"
#include "shared_exponent.h"

#define RAD(deg) ((deg) * (G_PI / 180))
/* Maximum number of rectifications that are kept, because making one takes ten times as long as
 * using it. If shots are in the quickest order, all angles of the turntable are needed again and
 * again. */
#define MAX_RECTIFIERS 64

/* The rectification of a camera at an angle of the turntable. */
struct rectifier {
    int camera;
    double turntable_rad;
    char *cfa;
    Rectify *rectify; /* NULL if the camera does not see the whole sample */
};

struct picture {
    GBytes *texels; /* NULL if the picture is not measured */
    /* checksum of the frame that was read last; it is also set if the frame could not be used */
    char *sha256;
};

struct Partial {
    Session *session;
    struct session_grid grid;
    struct calibration *calibration;
    GPtrArray *views, *lights, *shots;
    struct session_pairs *pairs;
    struct picture *pictures; /* for each pair */
    guint8 *holes;            /* for each texel, whether it is a hole in at least one picture */
    int n_measured;
    GQueue rectifiers; /* of struct rectifier */
    gint64 seen[2][2]; /* size and time of session.db and of its log at the last complete read */
};

static int n_texels(const Partial *partial) {
    return partial->grid.width * partial->grid.height;
}

static void rectifier_free(gpointer data) {
    struct rectifier *rectifier = data;
    rectify_free(rectifier->rectify);
    g_free(rectifier->cfa);
    g_free(rectifier);
}

void partial_free(Partial *partial) {
    if (!partial)
        return;
    for (int pair = 0; partial->pictures && pair < partial_n_pairs(partial); pair++) {
        g_clear_pointer(&partial->pictures[pair].texels, g_bytes_unref);
        g_free(partial->pictures[pair].sha256);
    }
    g_queue_clear_full(&partial->rectifiers, rectifier_free);
    g_free(partial->pictures);
    g_free(partial->holes);
    session_pairs_free(partial->pairs);
    g_clear_pointer(&partial->views, g_ptr_array_unref);
    g_clear_pointer(&partial->lights, g_ptr_array_unref);
    g_clear_pointer(&partial->shots, g_ptr_array_unref);
    calibration_free(partial->calibration);
    session_close(partial->session);
    g_free(partial);
}

/* Makes the grid coarser, so that width and height are at most PARTIAL_MAX_TEXELS and all pictures
 * together take at most PARTIAL_MAX_BYTES. */
static void choose_grid(Partial *partial) {
    struct session_grid *grid = &partial->grid;
    const double n_pairs = MAX(partial_n_pairs(partial), 1);
    const double bytes = 4 * n_pairs * grid->width * grid->height;
    const double most = MIN((double)PARTIAL_MAX_TEXELS / MAX(grid->width, grid->height),
                            sqrt((double)PARTIAL_MAX_BYTES / bytes));
    if (most >= 1)
        return;
    grid->width = MAX((int)(grid->width * most), 1);
    grid->height = MAX((int)(grid->height * most), 1);
}

static gboolean check_devices(const Partial *partial, GError **error) {
    const struct rig *rig = &partial->calibration->rig;
    gboolean good = TRUE;
    for (guint i = 0; i < partial->views->len; i++) {
        const struct session_direction *view = partial->views->pdata[i];
        good = good && view->device >= 0 && view->device < rig->n_cameras;
    }
    for (guint i = 0; i < partial->shots->len; i++) {
        const struct session_shot *shot = partial->shots->pdata[i];
        good = good && (shot->kind != SHOT_LAMP ||
                        (shot->device >= 0 && shot->device < rig->n_lamps && shot->source >= 0 &&
                         shot->source < (int)partial->lights->len));
    }
    return good || data_error_fail(session_path(partial->session), 0, error,
                                   "a view or a shot names a camera, a lamp or a light that the "
                                   "session does not have; restore the session from a copy");
}

static gboolean load(Partial *partial, const char *directory, GError **error) {
    Session *session = partial->session = session_open(directory, SESSION_READ, error);
    g_autofree char *text = session ? session_text(session, "calibration.conf", error) : NULL;
    if (!text || !(partial->calibration = calibration_from_text(text, directory, error)) ||
        !session_grid(session, &partial->grid, error) ||
        !(partial->views = session_views(session, error)) ||
        !(partial->lights = session_lights(session, error)) ||
        !(partial->shots = session_shots(session, error)) || !check_devices(partial, error))
        return FALSE;
    if (partial->views->len == 0 || partial->lights->len == 0 || partial->grid.width < 1 ||
        partial->grid.height < 1) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INCOMPLETE,
                    "%s: the plan has %u views and %u lights, so that there is no picture to show",
                    directory, partial->views->len, partial->lights->len);
        return FALSE;
    }
    partial->pairs = session_pairs_new(&partial->calibration->rig, partial->views, partial->lights,
                                       partial->shots);
    choose_grid(partial);
    partial->pictures = g_new0(struct picture, partial_n_pairs(partial));
    partial->holes = g_new0(guint8, n_texels(partial));
    return TRUE;
}

Partial *partial_open(const char *directory, GError **error) {
    g_autoptr(Partial) partial = g_new0(Partial, 1);
    return load(partial, directory, error) ? g_steal_pointer(&partial) : NULL;
}

const struct session_grid *partial_grid(const Partial *partial) {
    return &partial->grid;
}

const GPtrArray *partial_views(const Partial *partial) {
    return partial->views;
}

const GPtrArray *partial_lights(const Partial *partial) {
    return partial->lights;
}

int partial_n_pairs(const Partial *partial) {
    return partial->pairs ? session_pairs_n(partial->pairs) : 0;
}

int partial_n_measured(const Partial *partial) {
    return partial->n_measured;
}

GBytes *partial_picture(const Partial *partial, int pair) {
    return partial->pictures[pair].texels;
}

struct vec3 partial_point_mm(const Partial *partial, double column, double row) {
    return rectify_point_mm(&partial->grid, column + 0.5, row + 0.5);
}

/* Returns the rectification for a camera at an angle, which the Partial owns. Returns NULL if the
 * camera does not see the whole sample. */
static const Rectify *find_rectify(Partial *partial, const struct rig *rig, int camera,
                                   double turntable_rad, const char *cfa, GError **error) {
    struct rectifier *found = NULL;
    for (GList *at = partial->rectifiers.head; at; at = at->next) {
        struct rectifier *one = at->data;
        if (one->camera != camera || fabs(one->turntable_rad - turntable_rad) > 1e-9 ||
            strcmp(one->cfa, cfa) != 0)
            continue;
        return one->rectify;
    }
    found = g_new(struct rectifier, 1);
    *found = (struct rectifier){camera, turntable_rad, g_strdup(cfa),
                                rectify_new(&rig->cameras[camera],
                                            &partial->calibration->camera_radiometry[camera], cfa,
                                            turntable_rad, &partial->grid, error)};
    /* A random rectification is dropped. The shots go through all angles again and again. If the
     * rectification were dropped that has not been used for the longest time, it would always be
     * the one that is needed next. */
    if (partial->rectifiers.length == MAX_RECTIFIERS)
        rectifier_free(
            g_queue_pop_nth(&partial->rectifiers, (guint)g_random_int_range(0, MAX_RECTIFIERS)));
    g_queue_push_head(&partial->rectifiers, found);
    return found->rectify;
}

/* Subtracts the camera's glare from a mosaic, as btf_make.c does. cfa is the colour filter of the
 * frame; from a frame of kind "rgb", input_mosaic() has already made a mosaic. */
static void subtract_glare(const struct radiometry_camera *camera, const char *cfa, int width,
                           int height, float *mosaic) {
    double mean[3];
    float glare[3];
    if (!camera->known || !(camera->glare > 0))
        return;
    radiometry_glare(camera, cfa, width, height, mosaic, mean, glare);
    for (int i = 0; i < width * height; i++)
        mosaic[i] -= glare[radiometry_colour_at(cfa, i % width, i / width)];
}

/* Reads a frame and rectifies it. A texel is ρ = π L / (o E), with its radiance L, its irradiance E
 * from the lamp in the calibration, and the output o of the lamp. */
static GBytes *read_picture(Partial *partial, const struct session_shot *shot,
                            const struct session_frame *frame, double output, GError **error) {
    static const char *const any[] = {NULL};
    const struct calibration *calibration = partial->calibration;
    const double turntable_rad = RAD(session_frame_turntable_deg(frame, shot));
    const struct rig_camera *camera = &calibration->rig.cameras[frame->camera];
    const struct radiometry_lamp *lamp = &calibration->lamp_radiometry[shot->device];
    const gsize n = (gsize)n_texels(partial);
    struct input input = {.path = session_file(partial->session, frame->path),
                          .sha256 = g_strdup(frame->sha256),
                          .shot = shot->id,
                          .width = camera->width,
                          .height = camera->height};
    const char *cfa;
    g_autoptr(ExrPart) part = input_read(&input, any, error);
    float *mosaic = part ? (float *)input_mosaic(input.path, part, &cfa, error) : NULL;
    input_clear(&input);
    if (!mosaic)
        return NULL;
    g_autofree struct rig *rig = g_new(struct rig, 1);
    rig_at(&calibration->rig, turntable_rad, rig);
    const Rectify *rectify = find_rectify(partial, rig, frame->camera, turntable_rad, cfa, error);
    if (!rectify) {
        if (error && !*error)
            g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                        "camera %s does not see the whole sample", camera->name);
        return NULL;
    }
    g_autofree float *rgb = g_new(float, 3 * n), *irradiance = g_new(float, n);
    g_autofree guint8 *holes = g_new(guint8, n);
    guint32 *texels = g_new(guint32, n);
    subtract_glare(&calibration->camera_radiometry[frame->camera], cfa, camera->width,
                   camera->height, mosaic);
    rectify_apply(rectify, mosaic, rgb, holes);
    rectify_irradiance(&rig->arc, &rig->lamps[shot->device], RAD(shot->arc_deg), turntable_rad,
                       &partial->grid, irradiance);
    for (gsize i = 0; i < n; i++) {
        partial->holes[i] |= holes[i];
        for (gsize c = 0; c < 3; c++) {
            const double light =
                output * (lamp->known ? lamp->colour[c] : 1) * (double)irradiance[i];
            rgb[3 * i + c] = light > 0 ? (float)(G_PI * (double)rgb[3 * i + c] / light) : 0;
        }
        texels[i] = shared_exponent_pack(rgb + 3 * i);
    }
    return g_bytes_new_take(texels, n * sizeof *texels);
}

/* Returns whether session.db may have changed since the last complete read. ret receives its
 * present state, in the form of struct Partial's member seen. */
static gboolean has_changed(const Partial *partial, gint64 ret[2][2]) {
    static const char *const names[] = {"session.db", "session.db-wal"};
    for (int i = 0; i < 2; i++) {
        g_autofree char *path = session_file(partial->session, names[i]);
        GStatBuf info = {0};
        const gboolean there = g_stat(path, &info) == 0;
        ret[i][0] = there ? info.st_size : -1;
        ret[i][1] = there ? info.st_mtim.tv_sec * G_USEC_PER_SEC + info.st_mtim.tv_nsec / 1000 : -1;
    }
    return memcmp(ret, partial->seen, sizeof partial->seen) != 0;
}

/* Reads a frame if it has not been read yet. Returns whether it was read. */
static gboolean take_frame(Partial *partial, const struct session_frame *frame,
                           const struct outputs *outputs, GArray *ret_pairs, char **ret_problem) {
    if (frame->shot < 1 || frame->shot > (gint64)partial->shots->len)
        return FALSE;
    const struct session_shot *shot = partial->shots->pdata[frame->shot - 1];
    const int pair = session_pairs_of(partial->pairs, shot, frame->camera);
    struct picture *picture = pair >= 0 ? &partial->pictures[pair] : NULL;
    if (!picture || g_strcmp0(picture->sha256, frame->sha256) == 0)
        return FALSE;
    g_autoptr(GError) error = NULL;
    const gboolean known = partial->calibration->lamp_radiometry[shot->device].known;
    const double output = known ? outputs_of(outputs, shot->id) : 1;
    GBytes *texels = read_picture(partial, shot, frame, output, &error);
    g_free(picture->sha256);
    picture->sha256 = g_strdup(frame->sha256);
    if (!texels) {
        if (!*ret_problem)
            *ret_problem = g_strdup_printf("%s is left out: %s", frame->path, error->message);
        return TRUE;
    }
    partial->n_measured += !picture->texels;
    g_clear_pointer(&picture->texels, g_bytes_unref);
    picture->texels = texels;
    g_array_append_val(ret_pairs, pair);
    return TRUE;
}

gboolean partial_read(Partial *partial, int most, GArray *ret_pairs, char **ret_problem,
                      GError **error) {
    gint64 now[2][2];
    int taken = 0;
    if (!has_changed(partial, now))
        return TRUE;
    g_autoptr(GPtrArray) frames = session_frames(partial->session, error);
    struct outputs *outputs = frames ? outputs_load(partial->session, partial->shots, error) : NULL;
    if (!outputs)
        return FALSE;
    guint i = 0;
    for (; i < frames->len && taken < most; i++)
        taken += take_frame(partial, frames->pdata[i], outputs, ret_pairs, ret_problem);
    outputs_free(outputs);
    if (i == frames->len)
        memcpy(partial->seen, now, sizeof now);
    return TRUE;
}

/* Chooses the probes: texels that are no hole in any picture. They are spread by the additive
 * recurrence of the plastic number (Roberts 2018). */
static int choose_probes(const Partial *partial, int *ret_texels) {
    const int width = partial->grid.width, height = partial->grid.height;
    int n = 0;
    for (int i = 0; i < 4 * PARTIAL_PROBES && n < MIN(PARTIAL_PROBES, width * height); i++) {
        const double x = 0.5 + i * 0.7548776662466927, y = 0.5 + i * 0.5698402909980532;
        const int texel = (int)((y - floor(y)) * height) * width + (int)((x - floor(x)) * width);
        if (!partial->holes[texel])
            ret_texels[n++] = texel;
    }
    return n;
}

/* Lists the pairs that the remaining shots will take. */
static gboolean list_planned(Partial *partial, struct partial_sample *sample, GError **error) {
    g_autoptr(GPtrArray) shots = session_shots(partial->session, error);
    int n_shots = 0;
    if (!shots)
        return FALSE;
    sample->planned = g_new(int, partial_n_pairs(partial) + 1);
    sample->shots = g_new(int, partial_n_pairs(partial) + 1);
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        if (shot->state != SHOT_PLANNED)
            continue;
        n_shots++;
        for (int c = 0; c < partial->pairs->n_cameras; c++) {
            const int pair = session_pairs_of(partial->pairs, shot, c);
            if (pair < 0 || partial->pictures[pair].texels)
                continue;
            sample->shots[sample->n_planned] = n_shots;
            sample->planned[sample->n_planned++] = pair;
        }
    }
    return TRUE;
}

struct partial_sample *partial_sample(Partial *partial, GError **error) {
    struct partial_sample *sample = g_new0(struct partial_sample, 1);
    int texels[PARTIAL_PROBES];
    const int n = choose_probes(partial, texels);
    const gsize n_pairs = (gsize)partial_n_pairs(partial);
    sample->pairs = &partial->pairs->all;
    sample->n_probes = n;
    sample->n_measured = partial->n_measured;
    sample->at_mm = g_new(struct vec3, n + 1);
    sample->values = g_new(float, 3 * (gsize)n * n_pairs + 1);
    for (int i = 0; i < n; i++)
        sample->at_mm[i] = partial_point_mm(partial, texels[i] % partial->grid.width,
                                            (int)(texels[i] / partial->grid.width));
    for (gsize pair = 0; pair < n_pairs; pair++) {
        GBytes *picture = partial->pictures[pair].texels;
        const guint32 *from = picture ? g_bytes_get_data(picture, NULL) : NULL;
        for (int i = 0; i < n; i++) {
            float rgb[3] = {NAN, NAN, NAN};
            if (from)
                shared_exponent_unpack(from[texels[i]], rgb);
            for (gsize c = 0; c < 3; c++)
                sample->values[(3 * (gsize)i + c) * n_pairs + pair] = rgb[c];
        }
    }
    if (list_planned(partial, sample, error))
        return sample;
    partial_sample_free(sample);
    return NULL;
}

void partial_sample_free(struct partial_sample *sample) {
    if (!sample)
        return;
    g_free(sample->values);
    g_free(sample->at_mm);
    g_free(sample->planned);
    g_free(sample->shots);
    g_free(sample);
}
