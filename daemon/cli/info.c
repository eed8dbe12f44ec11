/* info: what is in a session directory or an EXR. */
#include "info.h"

#include "btf/btf.h"
#include "cli.h"
#include "exr/exr.h"
#include "history.h"
#include "lobes/lobes.h"
#include "plan/report.h"
#include "session/session.h"

#include <glib/gstdio.h>
#include <string.h>

#define SHOWN_PARTS  8 /* of a file, to people */
#define SHOWN_EVENTS 10

struct counts {
    int planned, done, skipped, frames, retakes, views, lights, lasers;
    gint64 bytes;
};

static void cli_info_free_array(gpointer array) {
    if (array)
        g_ptr_array_unref(array);
}

static int cli_info_length_of(GPtrArray *array) {
    const int n = array ? (int)array->len : 0;
    cli_info_free_array(array);
    return n;
}

static gboolean cli_info_count(Session *session, struct counts *ret, GError **error) {
    g_autoptr(GPtrArray) shots = session_shots(session, error);
    g_autoptr(GPtrArray) frames = shots ? session_frames(session, error) : NULL;
    if (!frames)
        return FALSE;
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        ret->planned += shot->state == SHOT_PLANNED;
        ret->done += shot->state == SHOT_DONE;
        ret->skipped += shot->state == SHOT_SKIPPED;
    }
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        ret->frames++;
        ret->retakes += frame->retakes;
        ret->bytes += frame->bytes;
    }
    ret->views = cli_info_length_of(session_views(session, NULL));
    ret->lights = cli_info_length_of(session_lights(session, NULL));
    ret->lasers = cli_info_length_of(session_lasers(session, NULL));
    return TRUE;
}

static int cli_info_by_name(gconstpointer a, gconstpointer b) {
    return strcmp(*(char *const *)a, *(char *const *)b);
}

static void list_products(const char *directory, const char *folder, GPtrArray *to) {
    g_autofree char *path = g_build_filename(directory, folder, NULL);
    g_autoptr(GDir) dir = g_dir_open(path, 0, NULL);
    const char *name;
    while (dir && (name = g_dir_read_name(dir)))
        if (g_str_has_suffix(name, ".exr"))
            g_ptr_array_add(to, g_build_filename(folder, name, NULL));
    g_ptr_array_sort(to, cli_info_by_name);
}

static GPtrArray *products(const char *directory) {
    GPtrArray *list = g_ptr_array_new_with_free_func(g_free);
    list_products(directory, "products", list);
    list_products(directory, "products/btf", list);
    return list;
}

static gint64 cli_info_size_of(const char *directory, const char *relative) {
    g_autofree char *path = g_build_filename(directory, relative, NULL);
    GStatBuf info;
    return g_stat(path, &info) == 0 ? info.st_size : 0;
}

static void cli_info_add_int(GVariantBuilder *to, const char *key, gint64 value) {
    g_variant_builder_add(to, "{sv}", key, g_variant_new_int64(value));
}

static void cli_info_add_double(GVariantBuilder *to, const char *key, double value) {
    g_variant_builder_add(to, "{sv}", key, g_variant_new_double(value));
}

static void add_string(GVariantBuilder *to, const char *key, const char *value) {
    g_variant_builder_add(to, "{sv}", key, g_variant_new_string(value ? value : ""));
}

static GVariant *events_variant(const GPtrArray *events) {
    GVariantBuilder list;
    g_variant_builder_init(&list, G_VARIANT_TYPE("aa{sv}"));
    for (guint i = 0; i < events->len; i++) {
        const struct session_event *event = events->pdata[i];
        g_variant_builder_open(&list, G_VARIANT_TYPE_VARDICT);
        cli_info_add_double(&list, "time_s", event->time_s);
        add_string(&list, "level", event->level);
        add_string(&list, "source", event->source);
        add_string(&list, "message", event->message);
        g_variant_builder_close(&list);
    }
    return g_variant_builder_end(&list);
}

static GVariant *products_variant(const char *directory, const GPtrArray *list) {
    GVariantBuilder builder;
    g_variant_builder_init(&builder, G_VARIANT_TYPE("aa{sv}"));
    for (guint i = 0; i < list->len; i++) {
        g_variant_builder_open(&builder, G_VARIANT_TYPE_VARDICT);
        add_string(&builder, "path", list->pdata[i]);
        cli_info_add_int(&builder, "bytes", cli_info_size_of(directory, list->pdata[i]));
        g_variant_builder_close(&builder);
    }
    return g_variant_builder_end(&builder);
}

/* Of all views that can be read. */
static struct btf_marks count_marks(const char *directory, const GPtrArray *list) {
    struct btf_marks marks = {0};
    for (guint i = 0; i < list->len; i++) {
        if (!g_str_has_prefix(list->pdata[i], "products/btf/"))
            continue;
        g_autofree char *path = g_build_filename(directory, list->pdata[i], NULL);
        struct exr_file *file = exr_read_headers(path, NULL);
        for (guint k = 0; file && k < file->parts->len; k++)
            btf_add_marks(g_ptr_array_index(file->parts, k), &marks);
        exr_file_free(file);
    }
    return marks;
}

/* Why it rests, in the words it was told with. */
static char *reason_of(Session *session, const char *state) {
    return strcmp(state, "paused") == 0 ? session_value(session, "reason") : NULL;
}

static void cli_info_print_json(Session *session, const char *state,
                                const struct session_grid *grid, const struct counts *counts,
                                const GPtrArray *events) {
    const char *directory = session_path(session);
    g_autoptr(GPtrArray) made = products(directory);
    g_autofree char *reason = reason_of(session, state);
    GVariantBuilder builder;
    g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
    add_string(&builder, "kind", "session");
    add_string(&builder, "name", session_name(session));
    add_string(&builder, "session", directory);
    add_string(&builder, "state", state);
    add_string(&builder, "reason", reason);
    g_autofree char *imported = session_value(session, "imported");
    add_string(&builder, "imported", imported);
    cli_info_add_int(&builder, "width", grid->width);
    cli_info_add_int(&builder, "height", grid->height);
    cli_info_add_double(&builder, "width_mm", grid->width_mm);
    cli_info_add_double(&builder, "height_mm", grid->height_mm);
    cli_info_add_int(&builder, "views", counts->views);
    cli_info_add_int(&builder, "lights", counts->lights);
    cli_info_add_int(&builder, "lasers", counts->lasers);
    cli_info_add_int(&builder, "shots", counts->planned + counts->done + counts->skipped);
    cli_info_add_int(&builder, "shots_done", counts->done);
    cli_info_add_int(&builder, "shots_skipped", counts->skipped);
    cli_info_add_int(&builder, "frames", counts->frames);
    cli_info_add_int(&builder, "retakes", counts->retakes);
    cli_info_add_int(&builder, "bytes", counts->bytes);
    const struct btf_marks marks = count_marks(directory, made);
    cli_info_add_int(&builder, "btf_values", marks.texels);
    cli_info_add_int(&builder, "btf_holes", marks.holes);
    cli_info_add_int(&builder, "btf_lower_bounds", marks.bounds);
    cli_info_add_int(&builder, "btf_shorter_exposures", marks.shorter);
    cli_info_add_int(&builder, "btf_predicted", marks.predicted);
    g_variant_builder_add(&builder, "{sv}", "products", products_variant(directory, made));
    g_variant_builder_add(&builder, "{sv}", "events", events_variant(events));
    cli_print_json(g_variant_builder_end(&builder));
}

static void print_marks(const char *directory, const GPtrArray *list) {
    const struct btf_marks marks = count_marks(directory, list);
    if (marks.holes + marks.bounds + marks.shorter + marks.predicted > 0)
        g_print("marks      of %" G_GINT64_FORMAT " values: %" G_GINT64_FORMAT
                " holes, %" G_GINT64_FORMAT " lower bounds (saturated), %" G_GINT64_FORMAT
                " from shorter exposures alone, %" G_GINT64_FORMAT
                " of pictures that were not taken, made of other lights'\n",
                marks.texels, marks.holes, marks.bounds, marks.shorter, marks.predicted);
}

static void print_products(const char *directory) {
    g_autoptr(GPtrArray) list = products(directory);
    int n_views = 0;
    gint64 view_bytes = 0;
    for (guint i = 0; i < list->len; i++) {
        const gint64 bytes = cli_info_size_of(directory, list->pdata[i]);
        if (g_str_has_prefix(list->pdata[i], "products/btf/")) {
            n_views++;
            view_bytes += bytes;
            continue;
        }
        g_autofree char *size = g_format_size((guint64)bytes);
        g_print("product    %s, %s\n", (const char *)list->pdata[i], size);
    }
    g_autofree char *size = g_format_size((guint64)view_bytes);
    if (n_views)
        g_print("product    products/btf, %d views, %s\n", n_views, size);
    print_marks(directory, list);
}

static void print_events(const GPtrArray *events) {
    const guint from = events->len > SHOWN_EVENTS ? events->len - SHOWN_EVENTS : 0;
    if (from > 0)
        g_print("\n%u earlier events (--json shows all)\n", from);
    else if (events->len > 0)
        g_print("\n");
    for (guint i = from; i < events->len; i++) {
        const struct session_event *event = events->pdata[i];
        g_print("%9.0f s  %-8s %s: %s\n", event->time_s, event->level, event->source,
                event->message);
    }
}

static void print_session(Session *session, const char *state, const struct session_grid *grid,
                          const struct counts *counts, const GPtrArray *events) {
    const int shots = counts->planned + counts->done + counts->skipped;
    g_autofree char *size = g_format_size((guint64)counts->bytes);
    g_autofree char *reason = reason_of(session, state);
    g_print("session    %s, %s\n", session_name(session), session_path(session));
    g_print("state      %s\n", state);
    if (reason && *reason)
        g_print("reason     %s\n", reason);
    g_autofree char *imported = session_value(session, "imported");
    if (imported)
        g_print("made of    %s\n", imported);
    if (strcmp(state, "done") != 0)
        g_print("to go on   mesorig resume %s\n", session_path(session));
    g_print("sample     %g × %g mm, %d × %d texels\n", grid->width_mm, grid->height_mm, grid->width,
            grid->height);
    g_print("directions %d views, %d lights, %d laser positions\n", counts->views, counts->lights,
            counts->lasers);
    g_print("shots      %d of %d done, %d skipped\n", counts->done, shots, counts->skipped);
    g_print("frames     %d, %s, %d retakes\n", counts->frames, size, counts->retakes);
    print_products(session_path(session));
    print_events(events);
}

/* What the database says while nobody captures: a session that says it is running was cut off. */
static const char *state_text(const char *state, const struct counts *counts) {
    if (counts->planned == 0)
        return "done";
    if (!state || strcmp(state, "running") == 0)
        return "checkpoint";
    return state;
}

int info_session(const char *directory) {
    g_autoptr(GError) error = NULL;
    struct counts counts = {0};
    struct session_grid grid;
    g_autoptr(Session) session = session_open(directory, SESSION_READ, &error);
    if (!session || !cli_info_count(session, &counts, &error) ||
        !session_grid(session, &grid, &error))
        return cli_fail(error);
    g_autoptr(GPtrArray) events = session_events(session, &error);
    if (!events)
        return cli_fail(error);
    g_autofree char *stored = session_value(session, "state");
    const char *state = state_text(stored, &counts);
    if (cli_json)
        cli_info_print_json(session, state, &grid, &counts, events);
    else
        print_session(session, state, &grid, &counts, events);
    return CLI_DONE;
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

static void cli_info_add_part(GVariantBuilder *to, const struct exr_part *part) {
    g_variant_builder_open(to, G_VARIANT_TYPE_VARDICT);
    add_string(to, "name", part->name);
    cli_info_add_int(to, "width", part->width);
    cli_info_add_int(to, "height", part->height);
    add_string(to, "type", part->type == EXR_HALF ? "half" : "float");
    g_variant_builder_add(
        to, "{sv}", "channels",
        g_variant_new_strv((const char *const *)part->channels, part->n_channels));
    GVariantBuilder attributes;
    g_variant_builder_init(&attributes, G_VARIANT_TYPE_VARDICT);
    for (guint i = 0; i < part->attributes->len; i++) {
        const struct exr_attribute *attribute = part->attributes->pdata[i];
        g_variant_builder_add(&attributes, "{sv}", attribute->name, attribute_variant(attribute));
    }
    g_variant_builder_add(to, "{sv}", "attributes", g_variant_builder_end(&attributes));
    g_variant_builder_close(to);
}

static const char *cli_info_kind_of(const struct exr_file *file) {
    const char *kind = "exr";
    for (guint i = 0; i < file->parts->len; i++)
        if (exr_get_string(file->parts->pdata[i], "mesorig.kind", &kind, NULL))
            break;
    return kind;
}

static void print_exr_json(const char *path, const struct exr_file *file) {
    GVariantBuilder builder, parts;
    g_variant_builder_init(&parts, G_VARIANT_TYPE("aa{sv}"));
    for (guint i = 0; i < file->parts->len; i++)
        cli_info_add_part(&parts, file->parts->pdata[i]);
    g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
    add_string(&builder, "kind", cli_info_kind_of(file));
    add_string(&builder, "path", path);
    g_variant_builder_add(&builder, "{sv}", "parts", g_variant_builder_end(&parts));
    cli_print_json(g_variant_builder_end(&builder));
}

static void print_part(const struct exr_part *part) {
    g_autoptr(GString) channels = g_string_new(NULL);
    for (int c = 0; c < part->n_channels; c++)
        g_string_append_printf(channels, "%s%s", c ? " " : "", part->channels[c]);
    g_print("%-24s %d × %d, %s, %s\n", part->name ? part->name : "(no name)", part->width,
            part->height, part->type == EXR_HALF ? "half" : "float", channels->str);
    for (guint i = 0; i < part->attributes->len; i++) {
        const struct exr_attribute *attribute = part->attributes->pdata[i];
        g_autoptr(GVariant) value = g_variant_ref_sink(attribute_variant(attribute));
        g_autofree char *text = g_variant_print(value, FALSE);
        g_print("    %-24s %s\n", attribute->name, text);
    }
}

static void print_eigenmaps(const struct exr_file *file) {
    const struct exr_part *weights = exr_file_part(file, "weights");
    const struct exr_part *lights = exr_file_part(file, "lights");
    const struct exr_part *map = exr_file_part(file, "E000_light_0000");
    if (strcmp(cli_info_kind_of(file), "eigenmaps") != 0 || !lights || !map)
        return;
    g_print("eigen-maps: %d terms of %d views × %d lights, %d × %d texels\n\n", weights->height,
            weights->width, lights->width, map->width, map->height);
}

static void print_lpca(const struct exr_file *file) {
    const struct exr_part *clusters = exr_file_part(file, "clusters");
    const struct exr_part *scales = exr_file_part(file, "scales");
    const struct exr_part *views = exr_file_part(file, "views");
    const struct exr_part *lights = exr_file_part(file, "lights");
    const char *quantise = "", *colours = "rgb";
    double error = 0;
    int grid = 0, levels = 1;
    if (strcmp(cli_info_kind_of(file), "lpca") != 0 || !clusters || !scales || !views || !lights)
        return;
    exr_get_string(clusters, "mesorig.quantise", &quantise, NULL);
    exr_get_string(clusters, "mesorig.colours", &colours, NULL);
    exr_get_double(clusters, "mesorig.error", &error, NULL);
    exr_get_int(clusters, "mesorig.grid", &grid, NULL);
    for (;; levels++) {
        g_autofree char *name = g_strdup_printf("mip%d.clusters", levels);
        if (!exr_file_part(file, name))
            break;
    }
    g_print("local PCA: %d × %d texels, clusters × components %d × %d in %s, ", clusters->width,
            clusters->height, scales->width, scales->height - 1, quantise);
    if (grid > 0)
        g_print("on a grid of %d", grid);
    else
        g_print("of %d views × %d lights", views->width, lights->width);
    g_print("%s, mip levels: %d; error %.2f %%\n\n",
            strcmp(colours, "log") == 0 ? ", in log-luminance" : "", levels, 100 * error);
}

static void print_lobes(const struct exr_file *file) {
    const struct exr_part *views = exr_file_part(file, "views");
    const struct exr_part *lights = exr_file_part(file, "lights");
    const struct exr_part *first = file->parts->pdata[0];
    enum lobes_model model;
    int lobes = 0, width = 0, height = 0;
    double error = 0, luminance = 0;
    if (!lobes_model_parse(cli_info_kind_of(file), &model) || !views || !lights)
        return;
    exr_get_int(first, "mesorig.lobes", &lobes, NULL);
    exr_get_int(first, "mesorig.width", &width, NULL);
    exr_get_int(first, "mesorig.height", &height, NULL);
    exr_get_double(first, "mesorig.error", &error, NULL);
    exr_get_double(first, "mesorig.luminance_error", &luminance, NULL);
    g_print("%s", cli_info_kind_of(file));
    if (lobes > 0)
        g_print(" of %d %s", lobes, lobes == 1 ? "lobe" : "lobes");
    g_print(": %d × %d texels, of %d views × %d lights; error %.2f %%, luminance off by %.4f\n\n",
            width, height, views->width, lights->width, 100 * error, luminance);
}

static void print_factors(const struct exr_file *file) {
    const struct exr_part *maps = exr_file_part(file, "maps");
    const struct exr_part *views = exr_file_part(file, "views");
    double error_mm = 0, texel_mm = 0;
    int measured = 0;
    if (strcmp(cli_info_kind_of(file), "mdf-factors") != 0 || !maps || !views)
        return;
    exr_get_int(maps, "mesorig.measured", &measured, NULL);
    exr_get_double(maps, "mesorig.error_mm", &error_mm, NULL);
    exr_get_double(maps, "texel_mm", &texel_mm, NULL);
    g_print("distances (MDF): %d maps of %d × %d texels of %.3g mm, for %d views measured and %d "
            "traced; off by %.3f mm RMS\n\n",
            maps->n_channels, maps->width, maps->height, texel_mm, measured,
            views->width - measured, error_mm);
}

static void print_blocks(const struct exr_file *file) {
    const struct exr_part *first = file->parts->pdata[0];
    double error_mm = 0, texel_mm = 0;
    int width = 0, height = 0;
    if (strcmp(cli_info_kind_of(file), "mdf-blocks") != 0)
        return;
    exr_get_int(first, "mesorig.width", &width, NULL);
    exr_get_int(first, "mesorig.height", &height, NULL);
    exr_get_double(first, "mesorig.error_mm", &error_mm, NULL);
    exr_get_double(first, "texel_mm", &texel_mm, NULL);
    g_print("distances (MDF): %u views of %d × %d texels of %.3g mm in 4 bit; off by %.3f mm "
            "RMS\n\n",
            file->parts->len, width, height, texel_mm, error_mm);
}

/* Parts lie one behind the other: a file that ends too soon lacks some of the last. */
static gboolean has_its_end(const char *path, const struct exr_file *file, GError **error) {
    const struct exr_part *last = file->parts->pdata[file->parts->len - 1];
    struct exr_part *part = exr_read_part(path, last->name, error);
    exr_part_free(part);
    return part != NULL;
}

static int info_exr(const char *path) {
    g_autoptr(GError) error = NULL;
    struct exr_file *file = exr_read_headers(path, &error);
    if (!file)
        return cli_fail(error);
    if (!has_its_end(path, file, &error)) {
        exr_file_free(file);
        return cli_fail(error);
    }
    if (cli_json) {
        print_exr_json(path, file);
    } else {
        print_eigenmaps(file);
        print_lpca(file);
        print_lobes(file);
        print_factors(file);
        print_blocks(file);
        for (guint i = 0; i < MIN(file->parts->len, SHOWN_PARTS); i++)
            print_part(file->parts->pdata[i]);
        if (file->parts->len > SHOWN_PARTS)
            g_print("… and %u parts more (--json shows all)\n", file->parts->len - SHOWN_PARTS);
    }
    exr_file_free(file);
    return CLI_DONE;
}

static int draw_history(const char *directory, const char *to) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(directory, SESSION_READ, &error);
    return session && history_write_png(session, to, &error) ? CLI_DONE : cli_fail(error);
}

static int cli_info_run(const struct command *command, int argc, char **argv) {
    g_autofree char *history = NULL;
    const GOptionEntry entries[] = {
        {"history", 0, 0, G_OPTION_ARG_FILENAME, &history,
         "Also draw how the capture of DIR went, over time", "FILE.png"},
        {0},
    };
    if (!cli_parse(command, entries, FALSE, &argc, &argv, 1, 1))
        return CLI_USAGE;
    g_autofree char *path = cli_absolute(argv[1]);
    const gboolean session = g_file_test(path, G_FILE_TEST_IS_DIR);
    if (history && !session)
        return cli_usage(command, "--history draws a session, and %s is none", argv[1]);
    if (history && draw_history(path, history) != CLI_DONE)
        return CLI_FAILED;
    return session ? info_session(path) : info_exr(path);
}

const struct command cli_info = {.name = "info",
                                 .arguments = "FILE|DIR",
                                 .help = "Show what a session or an EXR holds.",
                                 .run_arguments = cli_info_run};
