/* info: prints the contents of a session directory or an EXR file. */
#include "info.h"
#include "sessions.h"

#include "archive.h"
#include "base/plural.h"
#include "btf/btf.h"
#include "btf/btf_sigma.h"
#include "codecs/codecs.h"
#include "codecs/mdf_codecs/mdf_codec.h"
#include "common/cli.h"
#include "exr/exr.h"
#include "history.h"
#include "pipeline/prediction_product.h"
#include "plan/adaptive/adaptive.h"
#include "plan/report.h"

#include <gio/gio.h>
#include <glib/gstdio.h>
#include <string.h>

#define SHOWN_PARTS  8 /* maximum number of parts of a file in the text */
#define SHOWN_EVENTS 10

struct counts {
    int planned, done, skipped, frames, retakes, views, lights, lasers;
    /* numbers of sweeps and of lamp shots that were done, and that were left out */
    int sweeps, sweeps_left_out, lamps, lamps_left_out;
    gint64 bytes;
};

/* Returns the length of an array, and releases one reference of it. */
static int length_of(GPtrArray *array) {
    const int n = array ? (int)array->len : 0;
    g_clear_pointer(&array, g_ptr_array_unref);
    return n;
}

static gboolean count(Session *session, struct counts *ret, GError **error) {
    g_autoptr(GPtrArray) shots = session_shots(session, error);
    g_autoptr(GPtrArray) frames = shots ? session_frames(session, error) : NULL;
    if (!frames)
        return FALSE;
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        ret->planned += shot->state == SHOT_PLANNED;
        ret->done += shot->state == SHOT_DONE;
        ret->skipped += shot->state == SHOT_SKIPPED;
        ret->sweeps += shot->kind == SHOT_SWEEP && shot->state == SHOT_DONE;
        ret->lamps += shot->kind == SHOT_LAMP && shot->state == SHOT_DONE;
        const gboolean left_out = shot->state == SHOT_SKIPPED && shot->note &&
                                  g_str_has_prefix(shot->note, SESSION_LEFT_OUT);
        ret->sweeps_left_out += left_out && shot->kind == SHOT_SWEEP;
        ret->lamps_left_out += left_out && shot->kind == SHOT_LAMP;
    }
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        ret->frames++;
        ret->retakes += frame->retakes;
        ret->bytes += frame->bytes;
    }
    ret->views = length_of(session_views(session, NULL));
    ret->lights = length_of(session_lights(session, NULL));
    ret->lasers = length_of(session_lasers(session, NULL));
    return TRUE;
}

static int by_name(gconstpointer a, gconstpointer b) {
    return strcmp(*(char *const *)a, *(char *const *)b);
}

static void list_products(const char *directory, const char *folder, GPtrArray *to) {
    g_autofree char *path = g_build_filename(directory, folder, NULL);
    g_autoptr(GDir) dir = g_dir_open(path, 0, NULL);
    const char *name;
    while (dir && (name = g_dir_read_name(dir)))
        if (g_str_has_suffix(name, ".exr"))
            g_ptr_array_add(to, g_build_filename(folder, name, NULL));
    g_ptr_array_sort(to, by_name);
}

/* Counts the flags of all views that can be read. */
static struct btf_flag_counts count_marks(const char *directory, const GPtrArray *list) {
    struct btf_flag_counts marks = {0};
    for (guint i = 0; i < list->len; i++) {
        if (!g_str_has_prefix(list->pdata[i], "products/btf/"))
            continue;
        g_autofree char *path = g_build_filename(directory, list->pdata[i], NULL);
        struct exr_file *file = exr_read_headers(path, NULL);
        for (guint k = 0; file && k < file->parts->len; k++)
            btf_count_flags(g_ptr_array_index(file->parts, k), &marks);
        exr_file_free(file);
    }
    return marks;
}

/* Prints how many pictures the capture left out, and with which error the others predict them. */
static void tell_prediction(Record *to, Session *session) {
    struct prediction_known known;
    prediction_product_read(session, &known);
    if (known.left_out == 0)
        return;
    record_say(to,
               "predicted  %d{left_out_pictures} of %d pictures, left out by the capture; expected "
               "error %.2f{prediction_error:%%} of the BTF. Pictures that were taken are predicted "
               "from the others with an error of %.2f{prediction_left_out_error:%%}, "
               "%.1f{prediction_left_out_share:%%} of their values within 2 σ\n",
               known.left_out, known.pictures, known.error, known.left_out_error,
               known.left_out_share);
}

static void tell_products(Record *to, const char *directory) {
    g_autoptr(GPtrArray) list = g_ptr_array_new_with_free_func(g_free);
    list_products(directory, "products", list);
    list_products(directory, "products/btf", list);
    const struct btf_flag_counts marks = count_marks(directory, list);
    int n_views = 0;
    gint64 view_bytes = 0;
    record_say_if(to, marks.holes + marks.bounds + marks.shorter + marks.predicted > 0,
                  "flags      of %" G_GINT64_FORMAT "{btf_values} values: %" G_GINT64_FORMAT
                  "{btf_holes} holes, %" G_GINT64_FORMAT
                  "{btf_lower_bounds} lower bounds (saturated), %" G_GINT64_FORMAT
                  "{btf_shorter_exposures} from shorter exposures only, %" G_GINT64_FORMAT
                  "{btf_predicted} of pictures that were not taken, predicted from other lights\n",
                  marks.texels, marks.holes, marks.bounds, marks.shorter, marks.predicted);
    record_begin_list(to, "products");
    for (guint i = 0; i < list->len; i++) {
        g_autofree char *path = g_build_filename(directory, list->pdata[i], NULL);
        const gboolean is_view = g_str_has_prefix(list->pdata[i], "products/btf/");
        GStatBuf status;
        const gint64 bytes = g_stat(path, &status) == 0 ? status.st_size : 0;
        record_begin(to, NULL);
        record_say_if(to, !is_view, "product    %s{path}, %" G_GINT64_FORMAT "{bytes:size}\n",
                      (const char *)list->pdata[i], bytes);
        record_end(to);
        n_views += is_view;
        view_bytes += is_view ? bytes : 0;
    }
    record_end(to);
    if (n_views)
        record_say(to, "product    products/btf, %d %s, %" G_GINT64_FORMAT "{:size}\n",
                   PLURAL(n_views, "view"), view_bytes);
}

/* Reports the medians of the error bars. `mesorig check` also reports which pictures are worse. */
static void tell_sigma(Record *to, const char *directory) {
    struct btf_sigma_sums sigma;
    btf_sigma_sum(directory, &sigma);
    record_int(to, "btf_sigma_known", sigma.known);
    record_say_if(to, sigma.known > 0,
                  "error bars median σ %.4g{btf_sigma_median}, %.2f{btf_sigma_relative:%%} of a "
                  "value, in %d of %d pictures\n",
                  sigma.median, sigma.relative, sigma.known, sigma.lights);
}

/* Prints the calibration with which the products were made, or would be made. */
static gboolean tell_calibration(Record *to, Session *session, GError **error) {
    struct archive_calibration with;
    g_autoptr(Calibration) calibration = archive_calibration(session, &with, error);
    record_say(to, "calibrated %s{calibration}\n", with.said);
    record_boolean(to, "calibration_own", with.own);
    record_boolean(to, "calibration_mixed", with.mixed);
    archive_calibration_clear(&with);
    return calibration != NULL;
}

static void tell_events(Record *to, const GPtrArray *events) {
    const guint from = events->len > SHOWN_EVENTS ? events->len - SHOWN_EVENTS : 0;
    if (from > 0)
        record_say(to, "\n%u earlier events (--json shows all)\n", from);
    else if (events->len > 0)
        record_say(to, "\n");
    record_begin_list(to, "events");
    for (guint i = 0; i < events->len; i++) {
        const struct session_event *event = events->pdata[i];
        record_begin(to, NULL);
        record_say_if(to, i >= from, "%9.0f{time_s} s  %-8s{level} %s{source}: %s{message}\n",
                      event->time_s, event->level, event->source, event->message);
        record_end(to);
    }
    record_end(to);
}

/* Prints how many sweeps were left out by [lasers] stop = covered, and the share of the surface
 * that is known. */
static void tell_sweeps(Record *to, Session *session, const struct counts *counts) {
    g_autofree char *known = session_value(session, ADAPTIVE_KNOWN_PCT);
    g_autofree char *worst = session_value(session, ADAPTIVE_WORST_PCT);
    if (!known || !worst)
        return;
    record_say(to, "sweeps     %d{sweeps_done} taken, ", counts->sweeps);
    record_say_if(to, counts->sweeps_left_out > 0,
                  "%d{sweeps_left_out} left out as they would hardly add anything",
                  counts->sweeps_left_out);
    record_say(to,
               "%s; two sweeps or more agree on %.2f{sweeps_known_pct} %% of what views see, "
               "%.1f{sweeps_worst_view_pct} %% in the worst view\n",
               counts->sweeps_left_out > 0 ? "" : "which are all", g_ascii_strtod(known, NULL),
               g_ascii_strtod(worst, NULL));
}

/* Prints how many lamp shots were left out by [lights] sampling = adaptive, and the expected error
 * of their predicted pictures. */
static void tell_lamps(Record *to, Session *session, const struct counts *counts) {
    g_autofree char *expected = session_value(session, ADAPTIVE_ERROR_PCT);
    g_autoptr(GHashTable) rounds = session_values(session, ADAPTIVE_LIGHT_ROUNDS, NULL);
    if (!expected || !rounds)
        return;
    int n = 0;
    GHashTableIter iter;
    gpointer shots;
    g_hash_table_iter_init(&iter, rounds);
    while (g_hash_table_iter_next(&iter, NULL, &shots))
        n += *(const char *)shots != '\0'; /* the last round has no shots */
    record_int(to, "lamps_done", counts->lamps);
    record_int(to, "lamps_left_out", counts->lamps_left_out);
    record_say(to, "lamps      %d %s taken in %d{lamps_rounds} %s", PLURAL(counts->lamps, "shot"),
               PLURAL(n, "round"));
    if (counts->lamps_left_out > 0)
        record_say(to, ", %d left out", counts->lamps_left_out);
    record_say(to,
               "; with the other pictures predicted, the BTF has an expected error of "
               "%.2f{lamps_expected_error_pct} %%\n",
               g_ascii_strtod(expected, NULL));
}

static gboolean tell_session(Record *to, Session *session, const char *state,
                             const struct session_grid *grid, const struct counts *counts,
                             const GPtrArray *events, GError **error) {
    const int shots = counts->planned + counts->done + counts->skipped;
    const char *directory = session_path(session);
    /* the reason of a pause */
    g_autofree char *reason =
        strcmp(state, "paused") == 0 ? session_value(session, "reason") : NULL;
    g_autofree char *imported = session_value(session, "imported");
    g_autofree char *chosen = session_value(session, "chosen");
    record_string(to, "kind", "session");
    record_say(to, "session    %s{name}, %s{session}\n", session_name(session), directory);
    record_say(to, "state      %s{state}\n", state);
    record_say_if(to, reason && *reason, "reason     %s{reason}\n", reason);
    record_say_if(to, imported != NULL, "made of    %s{imported}\n", imported);
    if (strcmp(state, "done") != 0)
        record_say(to, "to go on   mesorig resume %s\n", directory);
    record_string(to, "chosen", chosen);
    record_add(to, "%d{width} %d{height}", grid->width, grid->height);
    record_say(to, "sample     %g{width_mm} × %g{height_mm} mm, %d × %d texels\n", grid->width_mm,
               grid->height_mm, grid->width, grid->height);
    record_say(to, "directions %d{views} %s, %d{lights} %s, %d{lasers} %s\n",
               PLURAL(counts->views, "view"), PLURAL(counts->lights, "light"),
               PLURAL(counts->lasers, "laser position"));
    record_int(to, "shots", shots);
    record_say(to, "shots      %d{shots_done} of %d done, %d{shots_skipped} skipped\n",
               counts->done, shots, counts->skipped);
    record_say(
        to, "files      %d{frames} of frames, %d{retakes} %s, %" G_GINT64_FORMAT "{bytes:size}\n",
        counts->frames, PLURAL(counts->retakes, "retake"), counts->bytes);
    tell_sweeps(to, session, counts);
    tell_lamps(to, session, counts);
    if (chosen)
        record_say(to, "chosen     %s\n", chosen);
    if (!imported && !tell_calibration(to, session, error))
        return FALSE;
    tell_products(to, directory);
    tell_prediction(to, session);
    tell_sigma(to, directory);
    tell_events(to, events);
    return TRUE;
}

gboolean info_session(const char *directory, Record *to, GError **error) {
    struct counts counts = {0};
    struct session_grid grid;
    g_autoptr(Session) session = session_open(directory, SESSION_READ, error);
    if (!session || !count(session, &counts, error) || !session_grid(session, &grid, error))
        return FALSE;
    g_autoptr(GPtrArray) events = session_events(session, error);
    if (!events)
        return FALSE;
    /* No process is capturing the session now. If its state is "running", the capture was
     * interrupted. */
    g_autofree char *stored = session_value(session, "state");
    const char *state = counts.planned == 0                         ? "done"
                        : !stored || g_str_equal(stored, "running") ? "unfinished"
                                                                    : stored;
    return tell_session(to, session, state, &grid, &counts, events, error);
}

static GVariant *attribute_variant(const struct exr_attribute *attribute) {
    switch (attribute->kind) {
    case EXR_KIND_STRING:
        return g_variant_new_string(attribute->string);
    case EXR_KIND_INT:
        return g_variant_new_int32(attribute->integer);
    case EXR_KIND_DOUBLE:
        return g_variant_new_double(attribute->v[0]);
    default:
        return g_variant_new_fixed_array(G_VARIANT_TYPE_DOUBLE, attribute->v, 3, sizeof(double));
    }
}

/* Records a part of an EXR file. If shown is TRUE, the part is also described in the text for
 * people. */
static void tell_part(Record *to, const struct exr_part *part, gboolean shown) {
    const char *type = part->type == EXR_HALF ? "half" : "float";
    g_autoptr(GString) channels = g_string_new(NULL);
    for (int c = 0; c < part->n_channels; c++)
        g_string_append_printf(channels, "%s%s", c ? " " : "", part->channels[c]);
    record_begin(to, NULL);
    record_string(to, "name", part->name);
    record_say_if(to, shown, "%-24s %d{width} × %d{height}, %s{type}, %s\n",
                  part->name ? part->name : "(no name)", part->width, part->height, type,
                  channels->str);
    record_variant(to, "channels",
                   g_variant_new_strv((const char *const *)part->channels, part->n_channels));
    record_begin(to, "attributes");
    for (guint i = 0; i < part->attributes->len; i++) {
        const struct exr_attribute *attribute = part->attributes->pdata[i];
        g_autoptr(GVariant) value = g_variant_ref_sink(attribute_variant(attribute));
        g_autofree char *text = g_variant_print(value, FALSE);
        record_variant(to, attribute->name, value);
        record_say_if(to, shown, "    %-24s %s\n", attribute->name, text);
    }
    record_end(to);
    record_end(to);
}

/* Describes an index map of `mesorig synthesize` (synthesis/index_map.h): its size, the size of its
 * sample, and the method. Returns NULL if the file is no such map. Free the text with g_free(). */
static char *index_map(const struct exr_file *file) {
    const struct exr_part *part = file->parts->pdata[0];
    const char *method = NULL;
    int width = 0, height = 0;
    double texel_mm = 0;
    if (!exr_get_string(part, "mesorig.method", &method, NULL) ||
        !exr_get_int(part, "sample_width", &width, NULL) ||
        !exr_get_int(part, "sample_height", &height, NULL) ||
        !exr_get_double(part, "texel_mm", &texel_mm, NULL))
        return NULL;
    return g_strdup_printf("index map of %d × %d texels (%.4g × %.4g mm), by %s, of a sample of %d "
                           "× %d; %u %s",
                           part->width, part->height, part->width * texel_mm,
                           part->height * texel_mm, method, width, height, file->parts->len,
                           file->parts->len == 1 ? "mip level" : "mip levels");
}

static gboolean exr(const char *path, Record *to, GError **error) {
    struct exr_file *file = exr_read_headers(path, error);
    if (!file)
        return FALSE;
    /* Parts are stored one after the other. In a truncated file, data of the last part are
     * therefore missing. */
    const guint n = file->parts->len;
    const struct exr_part *last = file->parts->pdata[n - 1];
    struct exr_part *part = exr_read_part(path, last->name, error);
    const gboolean whole = part != NULL;
    exr_part_free(part);
    const char *kind = "exr";
    for (guint i = 0; i < n; i++)
        if (exr_get_string(file->parts->pdata[i], "mesorig.kind", &kind, NULL))
            break;
    const struct codec *codec = codecs_find(kind);
    g_autofree char *text = whole && codec ? codec->describe_file(file) : NULL;
    for (gsize i = 0; whole && !codec && !text && mdf_codecs[i]; i++)
        if (g_str_equal(mdf_codecs[i]->kind, kind))
            text = mdf_codecs[i]->describe_file(file);
    if (whole && !text && g_str_equal(kind, "index"))
        text = index_map(file);
    if (whole) {
        record_string(to, "kind", kind);
        record_string(to, "path", path);
        if (text)
            record_say(to, "%s\n\n", text);
        record_begin_list(to, "parts");
        for (guint i = 0; i < n; i++)
            tell_part(to, file->parts->pdata[i], i < SHOWN_PARTS);
        record_end(to);
        if (n > SHOWN_PARTS)
            record_say(to, "… and %u parts more (--json shows all)\n", n - SHOWN_PARTS);
    }
    exr_file_free(file);
    return whole;
}

static char *history_option;
static const GOptionEntry entries[] = {
    {"history", 0, 0, G_OPTION_ARG_FILENAME, &history_option,
     "Draw the course of the capture over time", "FILE.svg|FILE.png"},
    {NULL},
};

static gboolean draw_history(const char *path, OutputFile *to, GError **error) {
    g_autoptr(Session) session = session_open(path, SESSION_READ, error);
    const char *written = session ? output_file_path(to, error) : NULL;
    return written && output_file_end(to, history_draw(session, written, error), error);
}

static int run(const struct call *call, GError **error) {
    g_autofree char *path = g_canonicalize_filename(call->arguments[0], NULL);
    const gboolean session = g_file_test(path, G_FILE_TEST_IS_DIR);
    if (history_option && !session)
        return cli_usage(call->command,
                         "--history needs a session directory, and %s is not a directory",
                         call->arguments[0]);
    g_autoptr(OutputFile) drawing = NULL;
    if (history_option && (!(drawing = cli_output(history_option, "plot", error)) ||
                           !draw_history(path, drawing, error)))
        return CLI_FAILED;
    if (!(session ? info_session : exr)(path, call->record, error))
        return CLI_FAILED;
    if (drawing)
        cli_tell_output(call->record, drawing);
    return CLI_DONE;
}

const struct command cli_info = {.name = "info",
                                 .arguments = "FILE|DIR",
                                 .examples = "  mesorig info weave.session\n"
                                             "  mesorig info weave.session --history course.svg\n",
                                 .help = "Show the contents of a session or of an EXR file.",
                                 .options = entries,
                                 .writes = TRUE,
                                 .min = 1,
                                 .max = 1,
                                 .run = run};
