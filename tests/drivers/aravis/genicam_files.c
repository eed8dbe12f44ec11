/*
 * genicam_files FILE.xml…: what the driver finds in cameras' GenICam files, without the cameras.
 *
 * Prints for each what triggers and exposes it, its pixel format and gain, which functions would be
 * switched off by which feature, which would stay on and why, and what is unknown. At the end it
 * counts features over all files.
 *
 * A file is read as a camera that has everything that the file lists: references to registers that
 * say what is implemented, available or locked, and what limits are, are taken out, since no camera
 * is there to fill them. It is read twice, with all registers ones and with all zeros, and then
 * every switch and choice is turned on.
 */
#include "aravis/pixels.h"
#include "aravis/raw.h"
#include "described_camera.h"

#include <string.h>

struct function {  /* in all readings of a file */
    char *feature; /* that is neutral in the end; NULL: none */
    char *left;    /* why it stays on, if it does so in each; else NULL */
    gboolean was_on;
};

struct total {
    guint files, switched, left;
    GHashTable *features; /* name → how many files */
};

static void function_free(gpointer data) {
    struct function *function = data;
    g_free(function->feature);
    g_free(function->left);
    g_free(function);
}

static void total_free(gpointer data) {
    g_hash_table_unref(((struct total *)data)->features);
    g_free(data);
}

static const char *first_of(ArvDevice *device, const char *const *names) {
    for (; *names; names++)
        if (arv_device_get_feature(device, *names))
            return *names;
    return NULL;
}

static gboolean has_entry(ArvDevice *device, const char *feature, const char *entry) {
    ArvGcNode *node = arv_device_get_feature(device, feature);
    const GSList *at = ARV_IS_GC_ENUMERATION(node)
                           ? arv_gc_enumeration_get_entries(ARV_GC_ENUMERATION(node))
                           : NULL;
    for (; at; at = at->next)
        if (g_strcmp0(arv_gc_feature_node_get_name(at->data), entry) == 0)
            return TRUE;
    return FALSE;
}

/* The best of the formats that the file lists, grey or of any colour filters. */
static const char *best_format(ArvDevice *device, gboolean grey) {
    ArvGcNode *node = arv_device_get_feature(device, "PixelFormat");
    const struct aravis_format *best = NULL;
    const GSList *at = ARV_IS_GC_ENUMERATION(node)
                           ? arv_gc_enumeration_get_entries(ARV_GC_ENUMERATION(node))
                           : NULL;
    for (; at; at = at->next) {
        gint64 code = arv_gc_enum_entry_get_value(at->data, NULL);
        const struct aravis_format *format = aravis_format_by_code((guint32)code);
        if (format && (format->cfa == CFA_MONO) == grey && (!best || format < best))
            best = format;
    }
    return best ? best->name : "none";
}

static void print_basics(ArvDevice *device) {
    static const char *const exposures[] = {"ExposureTime", "ExposureTimeAbs", "ExposureTimeRaw",
                                            NULL};
    static const char *const gains[] = {"Gain", "GainAbs", "GainRaw", NULL};
    static const char *const triggers[] = {"FrameStart", "FrameBurstStart", "AcquisitionStart",
                                           NULL};
    const char *trigger = NULL, *exposure = first_of(device, exposures),
               *gain = first_of(device, gains);
    for (gsize i = 0; triggers[i] && !trigger; i++)
        if (has_entry(device, "TriggerSelector", triggers[i]))
            trigger = triggers[i];
    gboolean software = has_entry(device, "TriggerSource", "Software") &&
                        arv_device_get_feature(device, "TriggerSoftware");
    g_print("  trigger %s%s; exposure %s; format %s, in colour %s; gain %s; size %s\n",
            trigger ? trigger : "none", software ? " by software" : "",
            exposure ? exposure : "none", best_format(device, TRUE), best_format(device, FALSE),
            gain ? gain : "none",
            arv_device_get_feature(device, "SensorWidth") ? "SensorWidth"
            : arv_device_get_feature(device, "WidthMax")  ? "WidthMax"
                                                          : "none");
}

/* Switches and choices, of whatever they may be. */
static void turn_on(ArvGc *gc, const char *name, GHashTable *seen) {
    g_autoptr(GRegex) harmless =
        g_regex_new("(off|none|disabled?|timed|normal)$", G_REGEX_CASELESS, 0, NULL);
    ArvGcNode *node = arv_gc_get_node(gc, name);
    if (!node || !g_hash_table_add(seen, node))
        return;
    if (ARV_IS_GC_BOOLEAN(node))
        arv_gc_boolean_set_value(ARV_GC_BOOLEAN(node), TRUE, NULL);
    if (ARV_IS_GC_ENUMERATION(node) && !g_str_has_suffix(name, "Selector")) {
        const GSList *entry = arv_gc_enumeration_get_entries(ARV_GC_ENUMERATION(node));
        for (; entry; entry = entry->next)
            if (!g_regex_match(harmless, arv_gc_feature_node_get_name(entry->data), 0, NULL) &&
                arv_gc_enumeration_set_string_value(
                    ARV_GC_ENUMERATION(node), arv_gc_feature_node_get_name(entry->data), NULL))
                break;
    }
    const GSList *at =
        ARV_IS_GC_CATEGORY(node) ? arv_gc_category_get_features(ARV_GC_CATEGORY(node)) : NULL;
    for (; at; at = at->next)
        turn_on(gc, at->data, seen);
}

/* Surveys before and after switching off, into functions: name → struct function. */
static gboolean survey(const char *xml, gsize size, guint8 fill, GHashTable *functions,
                       GHashTable *unknown) {
    g_autoptr(ArvDevice) device = described_camera_new(xml, size, fill);
    if (!arv_device_get_genicam(device))
        return FALSE;
    g_autoptr(GHashTable) seen = g_hash_table_new(NULL, NULL);
    turn_on(arv_device_get_genicam(device), "Root", seen);
    g_autoptr(GError) error = NULL;
    g_autoptr(GPtrArray) before = aravis_raw_survey(device, FALSE, &error);
    g_autoptr(GPtrArray) tried = before ? aravis_raw_survey(device, TRUE, &error) : NULL;
    g_autoptr(GPtrArray) after = tried ? aravis_raw_survey(device, FALSE, &error) : NULL;
    if (!after) {
        g_print("  %s\n", error->message);
        return FALSE;
    }
    for (guint i = 0; i < after->len; i++) {
        const struct aravis_raw *raw = after->pdata[i];
        struct function *function = g_hash_table_lookup(functions, raw->what);
        gboolean seen_off = function && !function->left;
        if (!function) {
            function = g_new0(struct function, 1);
            g_hash_table_insert(functions, g_strdup(raw->what), function);
        }
        if (!raw->why && !function->feature)
            function->feature = g_strndup(raw->feature, strcspn(raw->feature, "["));
        for (guint k = 0; raw->why && k < tried->len; k++) {
            const struct aravis_raw *try = tried->pdata[k];
            if (try->what == raw->what && !function->left && !seen_off)
                function->left = g_strdup_printf("%s = %s: %s", raw->feature, raw->value, try->why);
        }
        if (!raw->why)
            g_clear_pointer(&function->left, g_free);
        for (guint k = 0; k < before->len; k++) {
            const struct aravis_raw *was = before->pdata[k];
            function->was_on |= was->what == raw->what && was->why != NULL;
        }
    }
    g_auto(GStrv) names = aravis_raw_unknown(device);
    for (char **name = names; *name; name++)
        g_hash_table_add(unknown, g_strndup(*name, strcspn(*name, " ")));
    if (fill)
        print_basics(device);
    return TRUE;
}

static gint by_name(gconstpointer a, gconstpointer b) {
    return g_strcmp0(a, b);
}

static void count(GHashTable *totals, const char *what, const struct function *function) {
    struct total *total = g_hash_table_lookup(totals, what);
    if (!total) {
        total = g_new0(struct total, 1);
        total->features = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, NULL);
        g_hash_table_insert(totals, g_strdup(what), total);
    }
    total->files++;
    total->switched += function->feature && function->was_on && !function->left;
    total->left += function->left != NULL;
    const char *feature = function->feature ? function->feature : "(none)";
    guint n = GPOINTER_TO_UINT(g_hash_table_lookup(total->features, feature));
    g_hash_table_insert(total->features, g_strdup(feature), GUINT_TO_POINTER(n + 1));
}

static gboolean read_file(const char *path, GHashTable *totals, GHashTable *unknown_totals) {
    g_autoptr(GHashTable) functions =
        g_hash_table_new_full(g_str_hash, g_str_equal, g_free, function_free);
    g_autoptr(GHashTable) unknown = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, NULL);
    g_autofree char *text = NULL, *name = g_path_get_basename(path);
    gsize size = 0;
    g_autoptr(GError) error = NULL;
    if (!g_file_get_contents(path, &text, &size, &error)) {
        g_printerr("%s\n", error->message);
        return FALSE;
    }
    const char *begin = memchr(text, '<', size); /* arv-tool puts the camera's name before it */
    g_autoptr(GRegex) conditions =
        g_regex_new("<(pIsImplemented|pIsAvailable|pIsLocked|pMin|pMax|pInc)\\b[^>]*>[^<]*</\\1>",
                    G_REGEX_RAW | G_REGEX_OPTIMIZE, 0, NULL);
    g_autofree char *xml =
        begin ? g_regex_replace_literal(conditions, begin, (gssize)size - (begin - text), 0, "", 0,
                                        &error)
              : NULL;
    g_print("%s\n", name);
    if (!xml || !survey(xml, strlen(xml), 0xff, functions, unknown) ||
        !survey(xml, strlen(xml), 0, functions, unknown)) {
        g_print("  it cannot be read\n");
        return FALSE;
    }
    g_autoptr(GList) list = g_list_sort(g_hash_table_get_keys(functions), by_name);
    for (GList *at = list; at; at = at->next) {
        struct function *function = g_hash_table_lookup(functions, at->data);
        if (function->left)
            g_print("  left on: %s: %s\n", (char *)at->data, function->left);
        else
            g_print("  %s: %s: %s\n", function->was_on ? "switched off" : "off in both",
                    (char *)at->data, function->feature);
        count(totals, at->data, function);
    }
    g_autoptr(GList) names = g_list_sort(g_hash_table_get_keys(unknown), by_name);
    for (GList *at = names; at; at = at->next) {
        guint n = GPOINTER_TO_UINT(g_hash_table_lookup(unknown_totals, at->data));
        g_print("  unknown: %s\n", (char *)at->data);
        g_hash_table_insert(unknown_totals, g_strdup(at->data), GUINT_TO_POINTER(n + 1));
    }
    return TRUE;
}

static void print_totals(guint n_files, GHashTable *totals, GHashTable *unknown) {
    g_print("\n%u files\n", n_files);
    g_autoptr(GList) list = g_list_sort(g_hash_table_get_keys(totals), by_name);
    for (GList *at = list; at; at = at->next) {
        struct total *total = g_hash_table_lookup(totals, at->data);
        g_autoptr(GString) text = g_string_new(NULL);
        g_autoptr(GList) names = g_list_sort(g_hash_table_get_keys(total->features), by_name);
        for (GList *name = names; name; name = name->next)
            g_string_append_printf(
                text, "%s%s %u", text->len ? ", " : "", (char *)name->data,
                GPOINTER_TO_UINT(g_hash_table_lookup(total->features, name->data)));
        g_print("| %s | %u | %u | %s | %u |\n", (char *)at->data, total->files, total->switched,
                text->str, total->left);
    }
    g_autoptr(GList) names = g_list_sort(g_hash_table_get_keys(unknown), by_name);
    for (GList *at = names; at; at = at->next)
        g_print("unknown: %s %u\n", (char *)at->data,
                GPOINTER_TO_UINT(g_hash_table_lookup(unknown, at->data)));
}

int main(int argc, char **argv) {
    g_autoptr(GHashTable) totals =
        g_hash_table_new_full(g_str_hash, g_str_equal, g_free, total_free);
    g_autoptr(GHashTable) unknown = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, NULL);
    guint n = 0;
    for (int i = 1; i < argc; i++)
        n += (guint)read_file(argv[i], totals, unknown);
    print_totals(n, totals, unknown);
    return argc > 1 && n == (guint)argc - 1 ? 0 : 1;
}
