/* Converts pictures to the frames that a capture would have written. */
#include "import_poses_private.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/data_error.h"
#include "base/robust.h"
#include "exr/exr.h"
#include "exr/exr_half.h"
#include "frames/sweep.h"

#define SATURATION 0.98 /* part of white from which on a pixel counts as saturated */
#define MAX_DN_MS  ((double)EXR_HALF_LARGEST) /* maximum value of a frame in DN per ms */
/* maximum deviation of a picture's angle from the angle of its step, in steps */
#define UNEVEN      0.05
#define MAX_MISSING 0.1 /* largest share of a sweep's pictures that may be missing */
/* A peak is invalid if a picture is missing near it. Near means within BESIDE steps, or within
 * PULSE standard deviations of the pulse if that is farther. */
#define BESIDE 2.0
#define PULSE  4.0

static struct import_row *row_at(const struct import_set *set, guint i) {
    return &g_array_index(set->rows, struct import_row, i);
}

/* Reads a picture for the BTF. All such pictures of one view must be grey, or all in colour. */
static struct import_picture *read_lamp(const struct import_set *set, const struct import_row *row,
                                        GError **error) {
    g_autoptr(ImportPicture) picture = import_coding_picture(set, row, error);
    const struct import_row **first = &set->first[row->view];
    if (!picture)
        return NULL;
    if (!*first) {
        *first = row;
        set->in_colour[row->view] = !picture->grey;
    }
    if (picture->grey != set->in_colour[row->view])
        return g_steal_pointer(&picture);
    data_error_set(
        set->table, row->line, error,
        "%s is %s, but %s (line %d) of the same view is not; the pictures of camera %s at "
        "turntable_deg %g must be all grey or all in colour",
        row->name, picture->grey ? "grey" : "in colour", (*first)->name, (*first)->line,
        set->known->rig.cameras[row->camera].name, row->turntable_deg);
    return NULL;
}

gboolean import_frames_prepare(struct import_set *set, GError **error) {
    gboolean swept[RIG_MAX_CAMERAS] = {FALSE};
    set->first = g_new0(const struct import_row *, set->views->len);
    set->in_colour = g_new0(gboolean, set->views->len);
    for (guint i = 0; i < set->rows->len; i++) {
        const struct import_row *row = row_at(set, i);
        if (row->sweep ? swept[row->camera] : set->first[row->view] != NULL)
            continue;
        g_autoptr(ImportPicture) picture =
            row->sweep ? import_coding_picture(set, row, error) : read_lamp(set, row, error);
        if (!picture)
            return FALSE;
        swept[row->camera] |= row->sweep;
    }
    return TRUE;
}

static struct exr_part *new_part(const struct import_set *set, const struct import_row *row,
                                 const char *name, const char *const *channels, enum exr_type type,
                                 const char *cfa) {
    const struct rig_camera *camera = &set->known->rig.cameras[row->camera];
    g_autofree char *exposure = g_strdup_printf("%.0f", row->exposure_ms * 1e3);
    struct exr_part *part = exr_part_new(name, camera->width, camera->height, channels, type);
    exr_set_string(part, "mesorig.camera", camera->name);
    exr_set_int(part, "mesorig.shot", row->shot + 1);
    exr_set_double(part, "mesorig.turntable_deg", row->turntable_deg);
    exr_set_double(part, "mesorig.arc_deg", row->arc_deg);
    exr_set_string(part, "mesorig.cfa", cfa);
    exr_set_string(part, "mesorig.exposures_us", exposure);
    return part;
}

static gboolean write_part(const struct import_set *set, const struct import_row *row,
                           struct exr_part *part, struct session_frame *ret, GError **error) {
    const struct session_shot *shot = &g_array_index(set->shots, struct session_shot, row->shot);
    g_autofree char *relative = session_frame_path(shot, set->known->rig.cameras[row->camera].name);
    g_autofree char *path = session_file(set->session, relative);
    g_autoptr(ExrFile) file = exr_file_new();
    exr_file_add(file, part);
    *ret = (struct session_frame){
        .shot = shot->id, .camera = row->camera, .path = g_steal_pointer(&relative)};
    set->ret->n_frames++;
    return exr_write(path, file, EXR_PIZ, FALSE, error) &&
           (ret->sha256 = exr_sha256(path, &ret->bytes, error)) != NULL;
}

static gboolean check_numbers(const struct import_set *set, const struct import_row *row,
                              const struct import_picture *picture, gsize bad, gsize n,
                              GError **error) {
    set->ret->not_numbers += (gint64)bad;
    return import_picture_check_holes(picture, bad, n, set->table, row->line, row->name, error);
}

/* Returns an array that has 1 for each pixel that is saturated in at least one colour, otherwise 0;
 * g_free(). *ret_n is the number of saturated pixels. */
static guint8 *import_frames_saturated(const struct import_picture *picture, int *ret_n) {
    const gsize n = (gsize)picture->width * (gsize)picture->height;
    guint8 *saturated = g_new0(guint8, n);
    *ret_n = 0;
    for (gsize i = 0; i < n; i++) {
        const float *rgb = picture->rgb + 3 * i;
        saturated[i] = (double)MAX(MAX(rgb[0], rgb[1]), rgb[2]) >= SATURATION;
        *ret_n += saturated[i];
    }
    return saturated;
}

/* Gives a lamp picture to the checks of import_look.c. Must be called before the flat field is
 * applied, because later values do not show which pixels are saturated. */
static void look_at_lamp(const struct import_set *set, const struct import_row *row,
                         const struct import_picture *picture) {
    const struct rig *rig = &set->known->rig;
    const struct vec3 at_mm = {0, 0, set->wish->grid.reference_mm};
    const float *const rgb[3] = {picture->rgb, picture->rgb + 1, picture->rgb + 2};
    import_look_count(set->look, picture);
    import_look_add(set->look, row->view,
                    g_array_index(set->shots, struct session_shot, row->shot).source, rgb, 3,
                    (gsize)picture->width * (gsize)picture->height,
                    row->exposure_ms * rig_lamp_irradiance(&rig->arc, &rig->lamps[row->device],
                                                           row->arc_deg * G_PI / 180, at_mm));
}

static gboolean write_lamp(const struct import_set *set, const struct import_row *row,
                           struct session_frame *ret, GError **error) {
    /* names of the channels; indices: whether the picture is in colour, whether a pixel is
     * saturated */
    static const char *const names[2][2][5] = {{{"Y"}, {"Y", "saturated"}},
                                               {{"B", "G", "R"}, {"B", "G", "R", "saturated"}}};
    g_autoptr(ImportPicture) picture = read_lamp(set, row, error);
    if (!picture)
        return FALSE;
    look_at_lamp(set, row, picture);
    int n_saturated;
    g_autofree guint8 *saturated = import_frames_saturated(picture, &n_saturated);
    if (!import_coding_flatten(set, row, picture, error))
        return FALSE;
    const char *const *channels = names[!picture->grey][n_saturated > 0];
    const gsize n_colours = picture->grey ? 1 : 3;
    g_autoptr(ExrPart) part =
        new_part(set, row, "radiance", channels, EXR_HALF, picture->grey ? set->wish->cfa : "rgb");
    const gsize n = (gsize)part->width * (gsize)part->height;
    float most = 0;
    gsize bad = 0;
    for (gsize i = 0; i < n; i++) {
        gboolean good = TRUE;
        for (gsize c = 0; c < n_colours; c++) {
            const float value = picture->rgb[3 * i + (picture->grey ? c : 2 - c)];
            good &= isfinite(value);
            most = isfinite(value) ? MAX(most, value) : most;
            part->planes[c][i] =
                isfinite(value) ? value * IMPORT_WHITE_DN / (float)row->exposure_ms : NAN;
        }
        bad += !good;
        if (n_saturated > 0)
            part->planes[n_colours][i] = saturated[i];
    }
    if ((double)most * IMPORT_WHITE_DN / row->exposure_ms > MAX_DN_MS)
        return data_error_fail(
            set->table, row->line, error,
            "exposure_ms is %g, so that %s would contain up to %.2g DN/ms, but a frame can hold "
            "only %g; if the value is in seconds, give milliseconds",
            row->exposure_ms, row->name, (double)most * IMPORT_WHITE_DN / row->exposure_ms,
            MAX_DN_MS);
    exr_set_string(part, "mesorig.lamp", set->known->rig.lamps[row->device].name);
    exr_set_double(part, "mesorig.dark_dn", 0);
    exr_set_int(part, "mesorig.saturated", n_saturated);
    exr_set_string(part, "mesorig.unit", "DN/ms");
    return check_numbers(set, row, picture, bad, n, error) &&
           write_part(set, row, g_steal_pointer(&part), ret, error);
}

/* The pictures of one camera and sweep: rows[0] … rows[n − 1]. The pictures of some steps may be
 * missing. */
struct run {
    const struct import_row *rows;
    int n;
    /* from_deg: angle of the first picture
     * step_deg: angle between two steps */
    double from_deg, step_deg;
    int steps;         /* number of steps, including steps with a missing picture */
    gboolean *missing; /* whether the picture of each step is missing */
    /* The sweep as the session stores it. offset is the distance, in steps, from the angle of a
     * picture to the angle of its frame. It is 0.5 if a frame is the difference of two consecutive
     * pictures, otherwise 0. */
    double offset, sweep_from_deg, sweep_to_deg;
    int sweep_steps;
};

/* Returns the median of the angles, in degrees, between consecutive pictures of a sweep. */
static double usual_step(const struct import_row *rows, int n) {
    g_autofree double *distances = g_new(double, n);
    for (int i = 0; i + 1 < n; i++)
        distances[i] = rows[i + 1].sweep_deg - rows[i].sweep_deg;
    qsort(distances, (gsize)n - 1, sizeof *distances, robust_by_value);
    return distances[(n - 1) / 2];
}

static gboolean find_steps(const struct import_set *set, struct run *run, GError **error) {
    const struct import_row *rows = run->rows, *first = &rows[0], *last = &rows[run->n - 1];
    if (run->n < 4)
        return data_error_fail(set->table, first->line, error,
                               "the sweep that begins here has %d pictures, but needs at least 4; "
                               "add the others, or leave this sweep out",
                               run->n);
    run->from_deg = first->sweep_deg;
    run->step_deg = usual_step(rows, run->n);
    const double steps = (last->sweep_deg - first->sweep_deg) / run->step_deg + 1;
    if (!(steps < 2.0 * run->n))
        return data_error_fail(
            set->table, last->line, error,
            "the sweep that begins at line %d is not evenly spaced; give sweep_deg in even steps",
            first->line);
    run->steps = (int)lround(steps);
    run->step_deg = (last->sweep_deg - first->sweep_deg) / (run->steps - 1);
    run->offset = set->wish->edge == IMPORT_LINE ? 0 : 0.5;
    run->sweep_steps = set->wish->edge == IMPORT_LINE ? run->steps : run->steps - 1;
    run->sweep_from_deg = run->from_deg + run->offset * run->step_deg;
    run->sweep_to_deg = run->sweep_from_deg + (run->sweep_steps - 1) * run->step_deg;
    run->missing = g_new(gboolean, run->steps);
    for (int k = 0; k < run->steps; k++)
        run->missing[k] = TRUE;
    for (int i = 0; i < run->n; i++) {
        const double at = (rows[i].sweep_deg - run->from_deg) / run->step_deg;
        const int k = (int)lround(at);
        if (fabs(at - k) > UNEVEN)
            return data_error_fail(set->table, rows[i].line, error,
                                   "the sweep that begins at line %d has steps of %g°, but %s is "
                                   "at %g°, between two steps; give sweep_deg in even steps",
                                   first->line, run->step_deg, rows[i].name, rows[i].sweep_deg);
        if (!run->missing[k])
            return data_error_fail(set->table, rows[i].line, error,
                                   "the sweep that begins at line %d has two pictures at %g°, the "
                                   "second of which is %s; leave out one of them",
                                   first->line, rows[i].sweep_deg, rows[i].name);
        run->missing[k] = FALSE;
    }
    return TRUE;
}

static gboolean check_missing(const struct import_set *set, const struct run *run, GError **error) {
    const int missing = run->steps - run->n;
    for (int k = 1; k < run->steps; k++)
        if (run->missing[k] && (run->missing[k - 1] || missing > MAX_MISSING * run->steps))
            return data_error_fail(
                set->table, run->rows[0].line, error,
                "the sweep that begins here lacks %d of its %d pictures, for instance the one at "
                "%g°; at most one picture in ten may be missing, and never two in a row",
                missing, run->steps, run->from_deg + k * run->step_deg);
    set->ret->n_missing += missing;
    return TRUE;
}

/* The conversion of the pictures of a sweep to the frames that sweep_add() takes. */
struct feed {
    Sweep *sweep;
    enum import_edge edge;
    gsize n;
    float *before; /* the previous picture; NULL before the first picture */
    guint16 *frame;
};

static void import_frames_feed(struct feed *feed, const float *picture) {
    const float sign = feed->edge == IMPORT_LIGHTENS ? 1 : -1;
    if (feed->edge != IMPORT_LINE && !feed->before) {
        feed->before = g_memdup2(picture, sizeof *picture * feed->n);
        return;
    }
    for (gsize i = 0; i < feed->n; i++) {
        float dn = picture[i];
        if (feed->edge != IMPORT_LINE) {
            dn = sign * (picture[i] - feed->before[i]);
            feed->before[i] = picture[i];
        }
        feed->frame[i] = (guint16)lroundf(CLAMP(dn, 0, G_MAXUINT16));
    }
    sweep_add(feed->sweep, feed->frame);
}

/* Reads the pictures of a sweep. The picture before a missing picture is repeated. Pixels with a
 * value that is not a number become 0. In colour pictures the largest of a pixel's three values
 * counts, because a laser has one colour and the largest value saturates first. */
static gboolean feed_all(const struct import_set *set, const struct run *run, struct feed *to,
                         GError **error) {
    g_autofree float *picture = g_new0(float, to->n);
    for (int k = 0, row = 0; k < run->steps; k++) {
        if (!run->missing[k]) {
            g_autoptr(ImportPicture) read = import_coding_picture(set, &run->rows[row], error);
            gsize bad = 0;
            if (!read)
                return FALSE;
            for (gsize i = 0; i < to->n; i++) {
                const float *rgb = read->rgb + 3 * i, dn = MAX(MAX(rgb[0], rgb[1]), rgb[2]);
                const gboolean good = isfinite(rgb[0]) && isfinite(rgb[1]) && isfinite(rgb[2]);
                bad += !good;
                picture[i] = good ? dn * IMPORT_WHITE_DN : 0;
            }
            if (!check_numbers(set, &run->rows[row++], read, bad, to->n, error))
                return FALSE;
        }
        import_frames_feed(to, picture);
    }
    return TRUE;
}

/* Sets peaks whose pulse includes a missing picture to −1 (invalid). */
static void forget_missing(const struct run *run, gsize n, const struct sweep_pulses *pulses) {
    float *peak = pulses->peak;
    for (int k = 0; k < run->steps; k++)
        for (gsize i = 0; run->missing[k] && i < n; i++)
            if (peak[i] >= 0 && fabs((double)peak[i] + run->offset - k) <
                                    MAX(BESIDE, PULSE * (double)pulses->width[i]))
                peak[i] = -1;
}

static struct exr_part *sweep_part(const struct import_set *set, const struct run *run,
                                   const struct feed *fed) {
    static const char *const channels[] = {"intensity",   "peak",  "second_intensity",
                                           "second_peak", "width", NULL};
    struct exr_part *part = new_part(set, run->rows, "sweep", channels, EXR_FLOAT, set->wish->cfa);
    exr_set_string(part, "mesorig.laser", set->known->rig.lasers[run->rows->device].name);
    exr_set_string(part, "mesorig.unit", "DN");
    exr_set_double(part, "sweep.from_deg", run->sweep_from_deg);
    exr_set_double(part, "sweep.to_deg", run->sweep_to_deg);
    exr_set_int(part, "sweep.steps", run->sweep_steps);
    g_autofree float *second_width = g_new(float, fed->n);
    const struct sweep_pulses first = {exr_part_plane(part, "peak"), exr_part_plane(part, "width"),
                                       exr_part_plane(part, "intensity")};
    const struct sweep_pulses second = {exr_part_plane(part, "second_peak"), second_width,
                                        exr_part_plane(part, "second_intensity")};
    sweep_finish(fed->sweep, set->wish->threshold_dn, &first, &second);
    forget_missing(run, fed->n, &first);
    forget_missing(run, fed->n, &second);
    return part;
}

/* Compares the sweep of a camera with the sweep of its shot, because the plan has one sweep for all
 * cameras of a shot. The shot has the sweep of its first camera. Returns FALSE with an error if the
 * sweeps differ. */
static gboolean agree(const struct import_set *set, const struct run *run,
                      struct session_shot *shot, GError **error) {
    if (shot->sweep_steps == 0) {
        shot->sweep_from_deg = run->sweep_from_deg;
        shot->sweep_to_deg = run->sweep_to_deg;
        shot->sweep_steps = run->sweep_steps;
    }
    return (shot->sweep_steps == run->sweep_steps && shot->sweep_from_deg == run->sweep_from_deg &&
            shot->sweep_to_deg == run->sweep_to_deg) ||
           data_error_fail(set->table, run->rows->line, error,
                           "the sweep that begins here goes from %g° to %g° in %d steps, but the "
                           "sweep of another camera goes from %g° to %g° in %d; give all cameras "
                           "the same values of sweep_deg",
                           run->sweep_from_deg, run->sweep_to_deg, run->sweep_steps,
                           shot->sweep_from_deg, shot->sweep_to_deg, shot->sweep_steps);
}

/* Returns how many consecutive rows, from row `first` on, have the shot and camera of this row. */
static int run_length(const struct import_set *set, guint first) {
    const struct import_row *row = row_at(set, first);
    int n = 1;
    while (first + (guint)n < set->rows->len && row_at(set, first + (guint)n)->shot == row->shot &&
           row_at(set, first + (guint)n)->camera == row->camera)
        n++;
    return n;
}

/* Sets the sweeps of all shots. Called before anything is written, because the plan of a session
 * never changes. */
gboolean import_frames_plan(struct import_set *set, GError **error) {
    for (guint i = 0; i < set->rows->len;) {
        const struct import_row *row = row_at(set, i);
        struct run run = {.rows = row, .n = run_length(set, i)};
        i += (guint)run.n;
        if (!row->sweep)
            continue;
        const gboolean ok =
            find_steps(set, &run, error) && check_missing(set, &run, error) &&
            agree(set, &run, &g_array_index(set->shots, struct session_shot, row->shot), error);
        g_free(run.missing);
        if (!ok)
            return FALSE;
    }
    return TRUE;
}

/* Writes the frame of one camera in a shot, from the rows first … first + n − 1. */
static gboolean write_camera(const struct import_set *set, guint first, int n,
                             struct session_frame *ret, GError **error) {
    struct run run = {.rows = row_at(set, first), .n = n};
    if (!run.rows->sweep)
        return write_lamp(set, run.rows, ret, error);
    const struct rig_camera *camera = &set->known->rig.cameras[run.rows->camera];
    struct feed fed = {.edge = set->wish->edge, .n = (gsize)camera->width * (gsize)camera->height};
    gboolean ok = find_steps(set, &run, error);
    if (ok) {
        fed.sweep = sweep_new(camera->width, camera->height, run.steps,
                              (int)(SATURATION * IMPORT_WHITE_DN));
        fed.frame = g_new(guint16, fed.n);
        ok = feed_all(set, &run, &fed, error) &&
             write_part(set, run.rows, sweep_part(set, &run, &fed), ret, error);
        sweep_free(fed.sweep);
    }
    g_free(fed.before);
    g_free(fed.frame);
    g_free(run.missing);
    return ok;
}

gboolean import_frames_write(struct import_set *set, const struct work *work, GError **error) {
    const gint64 begun_us = g_get_monotonic_time();
    struct session_frame frames[RIG_MAX_CAMERAS];
    gboolean ok = TRUE;
    for (guint i = 0; ok && i < set->rows->len;) {
        const int shot = row_at(set, i)->shot;
        int n_frames = 0;
        while (ok && i < set->rows->len && row_at(set, i)->shot == shot) {
            const int n = run_length(set, i);
            frames[n_frames] = (struct session_frame){0};
            ok = write_camera(set, i, n, &frames[n_frames++], error);
            i += (guint)n;
        }
        ok = ok &&
             session_commit_shot(set->session, shot + 1, SHOT_DONE, frames, n_frames, NULL, error);
        for (int k = 0; k < n_frames; k++) {
            g_free(frames[k].path);
            g_free(frames[k].sha256);
        }
        ok = ok && work_tell(work, "import", (int)i, (int)set->rows->len, begun_us, error);
    }
    return ok;
}
