/* Small pictures of a session, as PNG in memory. */
#include "archive.h"

#include "base/png_bytes.h"
#include "btf/btf.h"

#include <gio/gio.h>
#include <math.h>
#include <string.h>

/* Maximum width of a picture in pixels. A wider picture is reduced by averaging pixels. */
#define MAX_WIDE 512
/* Minimum width of a picture in pixels. A narrower picture is enlarged by repeating pixels. */
#define WIDE       160
#define FRAME_WIDE 320 /* maximum width of a photograph in pixels */
#define MAX_FRAMES 32  /* maximum number of cameras with a photograph */
#define ELEVATIONS 3
#define LIGHTS     3
#define BRIGHT     0.99 /* share of the values that are not clipped */
/* Step between the polar angles for which the nearest views and lights are shown, beginning at
 * 0. */
#define SEEN_DEG 30.0
#define COLOURS  3

/* R, G, B of a picture, height × width × 3, linear. Values of top or more become white. */
struct shown {
    int width, height;
    float *rgb;
};

static guint8 srgb(float value) {
    const float v = value > 0 ? MIN(value, 1.0F) : 0; /* NaN becomes 0 as well */
    const float curved = v <= 0.0031308F ? 12.92F * v : 1.055F * powf(v, 1 / 2.4F) - 0.055F;
    return (guint8)lrintf(255 * curved);
}

static void add_picture(struct archive *archive, const struct shown *shown, float top,
                        const char *format, ...) G_GNUC_PRINTF(4, 5);
static void add_picture(struct archive *archive, const struct shown *shown, float top,
                        const char *format, ...) {
    const int square = (shown->width + MAX_WIDE - 1) / MAX_WIDE;
    const int times = MAX(1, WIDE / shown->width);
    const int width = MAX(1, shown->width / square), height = MAX(1, shown->height / square);
    g_autofree guint8 *rgb =
        g_new(guint8, (gsize)COLOURS * (gsize)(width * times) * (gsize)(height * times));
    guint8 *to = rgb;
    for (int y = 0; y < height * times; y++)
        for (int x = 0; x < width * times; x++) {
            float sum[COLOURS] = {0, 0, 0};
            for (int k = 0; k < square * square; k++) {
                const gsize row = (gsize)MIN(y / times * square + k / square, shown->height - 1);
                const gsize column = (gsize)MIN(x / times * square + k % square, shown->width - 1);
                for (gsize c = 0; c < COLOURS; c++)
                    sum[c] += shown->rgb[COLOURS * (row * (gsize)shown->width + column) + c];
            }
            for (int c = 0; c < COLOURS; c++)
                *to++ = srgb(sum[c] / ((float)(square * square) * top));
        }
    GBytes *png = png_bytes(rgb, width * times, height * times, NULL);
    if (!png)
        return;
    struct archive_picture *picture = g_new0(struct archive_picture, 1);
    va_list arguments;
    va_start(arguments, format);
    picture->caption = g_strdup_vprintf(format, arguments);
    va_end(arguments);
    picture->png = png;
    g_ptr_array_add(archive->pictures, picture);
}

static int by_value(gconstpointer a, gconstpointer b) {
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

/* Returns the value below which the given share of n values lies, but at least 1e-6. Values that
 * are not finite are left out. Returns 1 if no value is finite. */
static float quantile(const float *values, gsize n, double share) {
    g_autofree float *sorted = g_new(float, n + 1);
    gsize found = 0;
    for (gsize i = 0; i < n; i++)
        if (isfinite(values[i]))
            sorted[found++] = values[i];
    if (found == 0)
        return 1;
    qsort(sorted, found, sizeof *sorted, by_value);
    return MAX(sorted[(gsize)(share * (double)(found - 1))], 1e-6F);
}

/* Adds a frame as a grey picture. Each pixel of the picture is the mean over a square of pixels of
 * the frame, and over its planes if it has several. Adds nothing if the file cannot be read. */
static void add_frame(struct archive *archive, const struct session_shot *shot,
                      const struct session_frame *frame) {
    g_autofree char *path = g_build_filename(archive->path, frame->path, NULL);
    g_autoptr(ExrFile) file = exr_read(path, NULL);
    const struct exr_part *part = file && file->parts->len ? file->parts->pdata[0] : NULL;
    if (!part)
        return;
    /* The side of a square is even, so that each colour of a mosaic occurs equally often in the
     * square. */
    const int square = MAX(2, 2 * ((part->width + 2 * FRAME_WIDE - 1) / (2 * FRAME_WIDE)));
    const struct shown shown = {part->width / square, part->height / square,
                                g_new0(float, (gsize)COLOURS *(gsize)(part->width / square + 1) *
                                                  (gsize)(part->height / square + 1))};
    for (int y = 0; y < shown.height; y++)
        for (int x = 0; x < shown.width; x++) {
            float sum = 0;
            for (int k = 0; k < square * square * part->n_channels; k++) {
                const int at = k / part->n_channels;
                const gsize pixel = (gsize)(y * square + at / square) * (gsize)part->width +
                                    (gsize)(x * square + at % square);
                sum += part->planes[k % part->n_channels][pixel];
            }
            for (int c = 0; c < COLOURS; c++)
                shown.rgb[(gsize)COLOURS * ((gsize)y * (gsize)shown.width + (gsize)x) + (gsize)c] =
                    sum / (float)(square * square * part->n_channels);
        }
    const gsize n = (gsize)COLOURS * (gsize)shown.width * (gsize)shown.height;
    if (n > 0)
        add_picture(archive, &shown, quantile(shown.rgb, n, BRIGHT),
                    "%s, light %d, turntable at %.1f°",
                    archive->calibration->rig.cameras[frame->camera].name, shot->source,
                    shot->turntable_deg);
    g_free(shown.rgb);
}

/* Adds the first lamp frame of each camera. If there are more than MAX_FRAMES cameras, only every
 * second, third, … camera is used. */
static gboolean add_frames(struct archive *archive, Session *session, GError **error) {
    const int n_cameras = archive->calibration ? archive->calibration->rig.n_cameras : 0;
    const int every = MAX(1, (n_cameras + MAX_FRAMES - 1) / MAX_FRAMES);
    g_autoptr(GPtrArray) shots = session_shots(session, error);
    g_autoptr(GPtrArray) frames = shots ? session_frames(session, error) : NULL;
    struct camera_set seen = {{0}};
    guint s = 0;
    for (guint f = 0; frames && archive->calibration && f < frames->len; f++) {
        const struct session_frame *frame = frames->pdata[f];
        while (s < shots->len && ((struct session_shot *)shots->pdata[s])->id < frame->shot)
            s++;
        const struct session_shot *shot = s < shots->len ? shots->pdata[s] : NULL;
        if (!shot || shot->id != frame->shot || shot->kind != SHOT_LAMP || frame->camera < 0 ||
            frame->camera >= n_cameras || frame->camera % every != 0 ||
            camera_set_has(seen, frame->camera))
            continue;
        camera_set_add(&seen, frame->camera);
        add_frame(archive, shot, frame);
    }
    return frames != NULL;
}

/* Returns the direction that is nearest to (θ, φ) on the sphere, or NULL if there is none. */
static const struct session_direction *nearest(const GPtrArray *directions, double theta_deg,
                                               double phi_deg) {
    const struct session_direction *best = NULL;
    double most = -2;
    for (guint i = 0; i < directions->len; i++) {
        const struct session_direction *at = directions->pdata[i];
        const double t = at->theta_deg * G_PI / 180, u = theta_deg * G_PI / 180;
        const double cosine =
            cos(t) * cos(u) + sin(t) * sin(u) * cos((at->phi_deg - phi_deg) * G_PI / 180);
        if (cosine > most + 1e-9) {
            most = cosine;
            best = at;
        }
    }
    return best;
}

/* Adds pictures of the BTF. They form a table: in each row the polar angle of the view is the same,
 * and in each column that of the light. View and light are on opposite sides of the normal. All
 * pictures have the same scale of brightness. */
static gboolean add_btf(struct archive *archive, Session *session, GError **error) {
    g_autoptr(GPtrArray) views = session_views(session, error);
    g_autoptr(GPtrArray) lights = views ? session_lights(session, error) : NULL;
    const gsize n = (gsize)archive->grid.width * (gsize)archive->grid.height * COLOURS;
    g_autofree float *rgb = g_new(float, n);
    gint64 shown_pairs[ELEVATIONS * LIGHTS];
    float top = 0;
    int n_shown = 0;
    if (!lights)
        return FALSE;
    for (int k = 0; k < ELEVATIONS * LIGHTS && lights->len > 0; k++) {
        const int row = k / LIGHTS, column = k % LIGHTS;
        const struct session_direction *view = nearest(views, SEEN_DEG * row, 0);
        const struct session_direction *light = nearest(lights, SEEN_DEG * column, 180);
        g_autofree char *path =
            view ? g_strdup_printf("%s/products/btf/view_%04d.exr", archive->path, view->index)
                 : NULL;
        /* TRUE if this pair was shown before; with few directions, the same one may be the nearest
         * several times */
        gboolean again = FALSE;
        for (int i = 0; path && i < n_shown; i++)
            again = again || shown_pairs[i] == ((gint64)view->index << 32 | light->index);
        if (!path || again || !g_file_test(path, G_FILE_TEST_EXISTS) ||
            !btf_read_view(path, &light->index, 1, &archive->grid, 0, rgb, NULL))
            continue;
        shown_pairs[n_shown++] = (gint64)view->index << 32 | light->index;
        top = top > 0 ? top : quantile(rgb, n, BRIGHT);
        const struct shown shown = {archive->grid.width, archive->grid.height, rgb};
        add_picture(archive, &shown, top, "BTF: view θ %.0f° φ %.0f°, light θ %.0f° φ %.0f°",
                    view->theta_deg, view->phi_deg, light->theta_deg, light->phi_deg);
    }
    return TRUE;
}

/* Adds the distances of the steepest view. Near texels are bright, and unknown ones are blue. */
static gboolean add_mdf(struct archive *archive, Session *session, GError **error) {
    g_autofree char *path = g_build_filename(archive->path, "products", "mdf.exr", NULL);
    g_autoptr(GPtrArray) views = session_views(session, error);
    const struct session_direction *view = views ? nearest(views, 0, 0) : NULL;
    g_autofree char *name = view ? g_strdup_printf("view_%04d", view->index) : NULL;
    if (!view || !g_file_test(path, G_FILE_TEST_EXISTS))
        return views != NULL;
    g_autoptr(ExrPart) part = exr_read_part(path, name, NULL);
    float *distance = part ? exr_part_plane(part, "D") : NULL;
    if (!distance)
        return TRUE;
    const gsize n = (gsize)part->width * (gsize)part->height;
    g_autofree float *known = g_new(float, n), *rgb = g_new0(float, n *COLOURS);
    for (gsize i = 0; i < n; i++)
        known[i] = distance[i] >= 0 ? distance[i] : NAN;
    const float near = quantile(known, n, 1 - BRIGHT), far = quantile(known, n, BRIGHT);
    for (gsize i = 0; i < n; i++)
        for (int c = 0; c < COLOURS; c++)
            rgb[COLOURS * i + (gsize)c] = isnan(known[i])
                                              ? (c == 2 ? 0.8F : 0.05F)
                                              : (far - known[i]) / MAX(far - near, 1e-6F);
    const struct shown shown = {part->width, part->height, rgb};
    add_picture(archive, &shown, 1,
                "MDF: distances of view θ %.0f° φ %.0f°, from %.2f mm (bright) to %.2f mm (dark); "
                "blue is not known",
                view->theta_deg, view->phi_deg, (double)near, (double)far);
    return TRUE;
}

gboolean archive_add_pictures(struct archive *archive, const struct work *work, GError **error) {
    gboolean (*const add[])(struct archive *, Session *, GError **) = {add_frames, add_btf,
                                                                       add_mdf};
    const gint64 begun_us = g_get_monotonic_time();
    g_autoptr(Session) session = session_open(archive->path, SESSION_READ, error);
    for (gsize i = 0; session && i < G_N_ELEMENTS(add); i++)
        if (!add[i](archive, session, error) ||
            !work_tell(work, "pictures", (int)i + 1, G_N_ELEMENTS(add), begun_us, error))
            return FALSE;
    return session != NULL;
}
