#include "report.h"

#include "base/plural.h"

#include <math.h>

/* If the smaller size is at least this part of the larger one, only the larger one is reported. */
#define MIN_RANGE 0.95

char *report_duration(double seconds) {
    if (!isfinite(seconds) || seconds < 0 || seconds > 1e9)
        return g_strdup("?");
    const gint64 s = (gint64)(seconds + 0.5);
    if (s >= 86400)
        return g_strdup_printf("%d d %02d h", (int)(s / 86400), (int)(s / 3600 % 24));
    if (s >= 3600)
        return g_strdup_printf("%d h %02d min", (int)(s / 3600), (int)(s / 60 % 60));
    if (s >= 60)
        return g_strdup_printf("%d min %02d s", (int)(s / 60), (int)(s % 60));
    return seconds < 9.95 && seconds > 0 ? g_strdup_printf("%.1f s", seconds)
                                         : g_strdup_printf("%d s", (int)s);
}

GVariant *report_plan(const struct session_conf *conf, const struct plan *plan) {
    GVariantBuilder builder, notes;
    g_variant_builder_init(&notes, G_VARIANT_TYPE("as"));
    for (guint i = 0; plan->notes && i < plan->notes->len; i++)
        g_variant_builder_add(&notes, "s", (const char *)plan->notes->pdata[i]);

    g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
    const char *name = conf->name ? conf->name : "";
    g_variant_builder_add(&builder, "{sv}", "session", g_variant_new_string(name));
    g_variant_builder_add(&builder, "{sv}", "prompt",
                          g_variant_new_string(conf->prompt ? conf->prompt : ""));
    const struct {
        const char *key;
        int value;
    } counts[] = {
        {"views", plan->session.n_views},     {"lights", plan->session.n_lights},
        {"lasers", plan->session.n_lasers},   {"poses", plan->n_poses},
        {"shots", plan->session.n_shots},     {"frames", plan->n_frames},
        {"mounts", plan->n_mounts},           {"later_sweeps", plan->n_later_sweeps},
        {"later_lamps", plan->n_later_lamps}, {"passes", plan->n_passes},
        {"passing", plan->n_passing},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(counts); i++)
        g_variant_builder_add(&builder, "{sv}", counts[i].key,
                              g_variant_new_int32(counts[i].value));
    g_variant_builder_add(&builder, "{sv}", "bytes", g_variant_new_uint64(plan->bytes));
    g_variant_builder_add(&builder, "{sv}", "bytes_least", g_variant_new_uint64(plan->bytes_least));
    const struct {
        const char *key;
        double value;
    } times[] = {
        {"predicted_s", plan->predicted_s},
        {"lower_bound_s", plan->lower_bound_s},
        {"nested_s", plan->nested_s},
        {"first_s", plan->first_s},
        {"standing_s", plan->standing_s},
        {"pass_deg_s", plan->passes.deg_s},
        {"blur_texels", plan->passes.blur_texels},
        {"blur_mm", plan->passes.blur_mm},
        {"pose_texels", plan->passes.pose_texels},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(times); i++)
        g_variant_builder_add(&builder, "{sv}", times[i].key, g_variant_new_double(times[i].value));
    g_variant_builder_add(&builder, "{sv}", "notes", g_variant_builder_end(&notes));
    return g_variant_builder_end(&builder);
}

static int get_int(GVariant *report, const char *key) {
    gint32 value = 0;
    g_variant_lookup(report, key, "i", &value);
    return value;
}

static double get_double(GVariant *report, const char *key) {
    double value = 0;
    g_variant_lookup(report, key, "d", &value);
    return value;
}

/* Returns "about 21.3 MB of frames" or, if the sizes differ, "13.1 MB to 21.3 MB of frames, by …",
 * with the reason for the difference. */
static char *size_range(GVariant *report, guint64 least, guint64 most) {
    const gboolean lamps = get_int(report, "later_lamps") > 0;
    const gboolean sweeps = get_int(report, "later_sweeps") > 0;
    g_autofree char *max_text = g_format_size(most);
    g_autofree char *min_text = g_format_size(least);
    g_autoptr(GString) by = g_string_new(NULL);
    if (least == 0 || !((double)least < MIN_RANGE * (double)most))
        return g_strdup_printf("about %s of frames", max_text);
    if (lamps || sweeps)
        g_string_append_printf(by, "how many %s are needed",
                               !sweeps  ? "shots of lamps"
                               : !lamps ? "sweeps"
                                        : "shots of lamps and sweeps");
    if (get_int(report, "lasers") > 0)
        g_string_append_printf(by, "%show much the cameras see of the laser's lines",
                               by->len ? " and " : "");
    return g_strdup_printf("%s to %s of frames, depending on %s", min_text, max_text, by->str);
}

/* With [capture] motion = continuous, adds a line about the passes and a line with the predicted
 * time if the turntable stands still for all shots. */
static void add_passes(GVariant *report, GString *text) {
    const int passes = get_int(report, "passes"), passing = get_int(report, "passing");
    const double standing_s = get_double(report, "standing_s");
    if (standing_s == 0)
        return;
    g_autofree char *standing = report_duration(standing_s);
    g_string_append_printf(
        text,
        "turning         %d pass%s at %.3g°/s for %d %s: blur at most %.2f texels "
        "(%.2g mm), pose error at most %.2f texels\n",
        passes, passes == 1 ? "" : "es", get_double(report, "pass_deg_s"), PLURAL(passing, "shot"),
        get_double(report, "blur_texels"), get_double(report, "blur_mm"),
        get_double(report, "pose_texels"));
    g_string_append_printf(text, "with standing   %s\n", standing);
}

char *report_text(GVariant *report) {
    GString *text = g_string_new(NULL);
    const char *name = "";
    guint64 bytes = 0, least = 0;
    g_variant_lookup(report, "session", "&s", &name);
    g_variant_lookup(report, "bytes", "t", &bytes);
    g_variant_lookup(report, "bytes_least", "t", &least);
    const int later_sweeps = get_int(report, "later_sweeps");
    const int later_lamps = get_int(report, "later_lamps");
    g_autofree char *size = size_range(report, least, bytes);
    g_string_append_printf(text, "session         %s\n", name);
    const int views = get_int(report, "views"), lights = get_int(report, "lights");
    const int lasers = get_int(report, "lasers"), pictures = views * lights;
    const int shots = get_int(report, "shots"), frames = get_int(report, "frames");
    g_string_append_printf(text, "directions      %d %s, %d %s, %d %s", PLURAL(views, "view"),
                           PLURAL(lights, "light"), PLURAL(lasers, "laser position"));
    if (pictures > 0)
        g_string_append_printf(text, "; %d %s of the BTF", PLURAL(pictures, "picture"));
    g_string_append(text, "\n");
    g_string_append_printf(text, "poses           %d\n", get_int(report, "poses"));
    g_string_append_printf(text, "shots           %d, with %d %s\n", shots,
                           PLURAL(frames, "camera frame"));
    g_string_append_printf(text, "on disk         %s; products need additional space\n", size);
    const int mounts = get_int(report, "mounts");
    if (mounts > 0)
        g_string_append_printf(
            text, "laser mounts    %d by hand; the operator's time is not predicted\n", mounts);
    const double predicted_s = get_double(report, "predicted_s");
    const double bound_s = get_double(report, "lower_bound_s");
    const double nested_s = get_double(report, "nested_s");
    g_autofree char *predicted = report_duration(predicted_s);
    g_autofree char *bound = report_duration(bound_s);
    g_autofree char *nested = report_duration(nested_s);
    g_string_append_printf(text, "predicted time  %s", predicted);
    if (bound_s > 0)
        g_string_append_printf(text, ", %.1f %% above the lower bound of %s",
                               100 * (predicted_s / bound_s - 1), bound);
    g_string_append(text, "\n");
    if (later_sweeps > 0 || later_lamps > 0) {
        g_autofree char *first = report_duration(get_double(report, "first_s"));
        g_string_append_printf(text, "if sufficient   %s with only the first round of %s\n", first,
                               later_lamps == 0    ? "sweeps"
                               : later_sweeps == 0 ? "lamps"
                                                   : "lamps and sweeps");
    }
    add_passes(report, text);
    if (predicted_s > 0)
        g_string_append_printf(text, "nested order    %s, %.2f times as long\n", nested,
                               nested_s / predicted_s);
    g_autofree const char **notes = NULL;
    g_variant_lookup(report, "notes", "^a&s", &notes);
    for (int i = 0; notes && notes[i]; i++)
        g_string_append_printf(text, "note            %s\n", notes[i]);
    return g_string_free(text, FALSE);
}
