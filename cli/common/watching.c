#include "watching.h"

#include "picture.h"

#include <gio/gio.h>
#include <math.h>
#include <string.h>
#include <unistd.h>

#define WIDEST      32 /* maximum width of a picture in columns */
#define NARROWEST   12
#define OTHER_LINES 6 /* lines of a terminal that are not used for pictures */

struct shown {
    Watching *watching;
    char *name;
    guint8 *rgb; /* NULL before the first picture */
    int width, height;
    /* `asked` is TRUE while a call for the picture is under way. `stale` is TRUE if a newer picture
     * has appeared since that call. */
    gboolean asked, stale;
};

struct Watching {
    BusRig1 *rig;
    Progress *progress;
    gboolean pictures;
    GPtrArray *cameras; /* of struct shown, in order of arrival */
    GCancellable *cancellable;
};

static void shown_free(gpointer data) {
    struct shown *shown = data;
    g_free(shown->name);
    g_free(shown->rgb);
    g_free(shown);
}

static double turn_deg(double deg) {
    return deg - 360 * floor(deg / 360);
}

char *watching_pose(BusRig1 *rig) {
    const char *kind, *name, *class_name, *place;
    double turntable_deg, arc_deg, theta_deg, phi_deg;
    gboolean carried;
    GVariant *pose = bus_rig1_get_pose(rig), *places = bus_rig1_get_places(rig);
    if (!pose || !places)
        return NULL;
    g_variant_get(pose, "(dd&s&s)", &turntable_deg, &arc_deg, &kind, &name);
    if (!*kind)
        return NULL;
    GString *text = g_string_new(NULL);
    g_string_append_printf(text, "turntable %g°, arc %g°: %s", turntable_deg, arc_deg,
                           *name ? name : "dark frames");
    GVariantIter iter;
    g_variant_iter_init(&iter, places);
    while (g_variant_iter_next(&iter, "(&s&sddb)", &class_name, &place, &theta_deg, &phi_deg,
                               &carried))
        if (strcmp(class_name, kind) == 0 && strcmp(place, name) == 0)
            g_string_append_printf(text, ", light from θ %.1f°, φ %.1f° of the sample", theta_deg,
                                   turn_deg(phi_deg + (carried ? arc_deg : 0) - turntable_deg));
    return g_string_free(text, FALSE);
}

/* Adds the names and pictures of the cameras next to each other. Pictures for which there is no
 * space are left out. */
static void add_pictures(const Watching *watching, GString *to, int *lines) {
    int columns, rows, tallest = 0;
    picture_terminal_size(STDERR_FILENO, &columns, &rows);
    const int n = MIN((int)watching->cameras->len, columns / (NARROWEST + 1));
    if (n == 0 || rows <= OTHER_LINES)
        return;
    const int wide = MIN(columns / n - 1, WIDEST);
    g_autoptr(GPtrArray) texts = g_ptr_array_new_with_free_func((GDestroyNotify)g_strfreev);
    g_autofree int *widths = g_new0(int, n);
    for (int i = 0; i < n; i++) {
        const struct shown *shown = watching->cameras->pdata[i];
        int high = 0;
        g_autofree char *text =
            picture_text(shown->rgb, shown->width, shown->height, PICTURE_BLOCKS, wide,
                         rows - OTHER_LINES, &widths[i], &high);
        g_ptr_array_add(texts, g_strsplit(text, "\n", -1));
        tallest = MAX(tallest, high);
        g_string_append_printf(to, "%-*.*s ", wide, wide, shown->name);
    }
    g_string_append_c(to, '\n');
    for (int line = 0; line < tallest; line++) {
        for (int i = 0; i < n; i++) {
            char **of = texts->pdata[i];
            const gboolean there = line < (int)g_strv_length(of) && *of[line];
            g_string_append_printf(to, "%s%*s", there ? of[line] : "",
                                   there ? wide - widths[i] + 1 : wide + 1, "");
        }
        g_string_append_c(to, '\n');
    }
    *lines += 1 + tallest;
}

void watching_show(Watching *watching) {
    g_autofree char *pose = watching_pose(watching->rig);
    g_autoptr(GString) text = g_string_new(NULL);
    int lines = 0;
    if (watching->pictures)
        add_pictures(watching, text, &lines);
    if (pose) {
        int columns, rows;
        picture_terminal_size(STDERR_FILENO, &columns, &rows);
        g_autofree char *cut = g_utf8_substring(pose, 0, MIN(columns - 1, g_utf8_strlen(pose, -1)));
        g_string_append_printf(text, "%s\n", cut);
        lines++;
    }
    progress_set_above(watching->progress, text->str, lines);
}

static void ask(struct shown *shown);

static void on_answer(GObject *proxy, GAsyncResult *result, gpointer data) {
    struct shown *shown = data;
    g_autoptr(GError) error = NULL;
    g_autoptr(GVariant) answer = g_dbus_proxy_call_finish(G_DBUS_PROXY(proxy), result, &error);
    guint width, height;
    double time_s;
    gsize length;
    if (g_error_matches(error, G_IO_ERROR, G_IO_ERROR_CANCELLED))
        return; /* watching_free() has cancelled the call */
    shown->asked = FALSE;
    if (answer) {
        g_autoptr(GVariant) bytes = NULL;
        g_variant_get(answer, "(uu@ayd)", &width, &height, &bytes, &time_s);
        const guint8 *rgb = g_variant_get_fixed_array(bytes, &length, 1);
        if (length > 0 && length == (gsize)3 * width * height) {
            g_free(shown->rgb);
            shown->rgb = g_memdup2(rgb, length);
            shown->width = (int)width;
            shown->height = (int)height;
            watching_show(shown->watching);
        }
    }
    if (shown->stale)
        ask(shown);
}

static void ask(struct shown *shown) {
    shown->stale = shown->asked;
    if (shown->asked)
        return;
    shown->asked = TRUE;
    g_dbus_proxy_call(G_DBUS_PROXY(shown->watching->rig), "GetThumbnail",
                      g_variant_new("(s)", shown->name), G_DBUS_CALL_FLAGS_NONE, -1,
                      shown->watching->cancellable, on_answer, shown);
}

static void on_thumbnail(BusRig1 *rig, const char *name, gpointer data) {
    Watching *watching = data;
    for (guint i = 0; i < watching->cameras->len; i++) {
        struct shown *shown = watching->cameras->pdata[i];
        if (strcmp(shown->name, name) == 0) {
            ask(shown);
            return;
        }
    }
    struct shown *shown = g_new0(struct shown, 1);
    shown->watching = watching;
    shown->name = g_strdup(name);
    g_ptr_array_add(watching->cameras, shown);
    ask(shown);
}

Watching *watching_new(BusRig1 *rig, Progress *progress, gboolean pictures) {
    Watching *watching = g_new0(Watching, 1);
    watching->rig = rig;
    watching->progress = progress;
    watching->pictures = pictures && picture_way(STDERR_FILENO) != PICTURE_NOT;
    watching->cameras = g_ptr_array_new_with_free_func(shown_free);
    watching->cancellable = g_cancellable_new();
    if (watching->pictures)
        g_signal_connect(rig, "thumbnail-changed", G_CALLBACK(on_thumbnail), watching);
    return watching;
}

void watching_free(Watching *watching) {
    if (!watching)
        return;
    g_signal_handlers_disconnect_by_data(watching->rig, watching);
    g_cancellable_cancel(watching->cancellable);
    while (g_main_context_iteration(NULL, FALSE)) /* lets cancelled calls finish */
        ;
    g_object_unref(watching->cancellable);
    g_ptr_array_unref(watching->cameras);
    g_free(watching);
}
