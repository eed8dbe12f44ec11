#include "setting.h"

#include <gio/gio.h>

#include "setting_text.h"

#define AGAIN_US  20000
#define MAX_SHOWN 30 /* values of a list that an error names */

typedef CameraWidget Widget;
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Widget, gp_widget_free)

static Widget *get_widget(Camera *camera, GPContext *context, const char *name) {
    Widget *widget = NULL;
    return gp_camera_get_single_config(camera, name, &widget, context) >= GP_OK ? widget : NULL;
}

static char *read_value(Widget *widget) {
    CameraWidgetType type;
    const char *text = NULL;
    float number = 0;
    int on = 0;
    gp_widget_get_type(widget, &type);
    switch (type) {
    case GP_WIDGET_TEXT:
    case GP_WIDGET_RADIO:
    case GP_WIDGET_MENU:
        return gp_widget_get_value(widget, &text) >= GP_OK && text ? g_strdup(text) : NULL;
    case GP_WIDGET_RANGE:
        gp_widget_get_value(widget, &number);
        return g_strdup_printf("%g", (double)number);
    case GP_WIDGET_TOGGLE:
        gp_widget_get_value(widget, &on);
        return g_strdup_printf("%d", on);
    default:
        return NULL;
    }
}

static char **read_choices(Widget *widget) {
    const int n = gp_widget_count_choices(widget);
    if (n <= 0)
        return NULL;
    char **choices = g_new0(char *, (gsize)n + 1);
    for (int i = 0; i < n; i++) {
        const char *choice = NULL;
        gp_widget_get_choice(widget, i, &choice);
        choices[i] = g_strdup(choice ? choice : "");
    }
    return choices;
}

char *setting_get(Camera *camera, GPContext *context, const char *name) {
    g_autoptr(Widget) widget = get_widget(camera, context, name);
    return widget ? read_value(widget) : NULL;
}

char **setting_choices(Camera *camera, GPContext *context, const char *name) {
    g_autoptr(Widget) widget = get_widget(camera, context, name);
    return widget ? read_choices(widget) : NULL;
}

static gboolean fail(GError **error, const char *format, ...) G_GNUC_PRINTF(2, 3);
static gboolean fail(GError **error, const char *format, ...) {
    va_list args;
    va_start(args, format);
    if (error)
        *error = g_error_new_valist(G_IO_ERROR, G_IO_ERROR_FAILED, format, args);
    va_end(args);
    return FALSE;
}

static gboolean refuse(const char *name, const char *value, char **choices, GError **error) {
    const int nearest = setting_text_nearest(value, (const char *const *)choices);
    if (nearest >= 0)
        return fail(error, "the camera does not offer %s = %s; the nearest value is %s", name,
                    value, choices[nearest]);
    g_autoptr(GString) names = g_string_new(NULL);
    for (int i = 0; choices[i] && i < MAX_SHOWN; i++)
        g_string_append_printf(names, "%s%s", i ? ", " : "", choices[i]);
    return fail(error, "the camera does not offer %s = %s; choose from: %s", name, value,
                names->str);
}

/* Puts the value into the widget. If the widget is a list, it gets the value as the list spells
 * it. */
static gboolean fill(Widget *widget, const char *name, const char *value, GError **error) {
    CameraWidgetType type;
    g_auto(GStrv) choices = read_choices(widget);
    gp_widget_get_type(widget, &type);
    if (choices) {
        int i = 0;
        while (choices[i] && !setting_text_equal(choices[i], value))
            i++;
        if (!choices[i])
            return refuse(name, value, choices, error);
        return gp_widget_set_value(widget, choices[i]) >= GP_OK;
    }
    if (type == GP_WIDGET_TEXT)
        return gp_widget_set_value(widget, value) >= GP_OK;
    const double number = setting_text_number(value);
    if (number < 0)
        return fail(
            error,
            "the setting %s needs a number of at least 0, not “%s”; correct it in the rig file",
            name, value);
    if (type == GP_WIDGET_RANGE)
        return gp_widget_set_value(widget, &(float){(float)number}) >= GP_OK;
    if (type == GP_WIDGET_TOGGLE)
        return gp_widget_set_value(widget, &(int){(int)number}) >= GP_OK;
    return fail(error,
                "the setting %s takes no value that can be written here; remove it from settings",
                name);
}

/* Reads the setting until it has the value. */
static gboolean await(Camera *camera, GPContext *context, const char *name, const char *value,
                      gint64 deadline_us, GError **error) {
    for (;;) {
        g_autofree char *is = setting_get(camera, context, name);
        if (is && setting_text_equal(is, value))
            return TRUE;
        if (g_get_monotonic_time() >= deadline_us)
            return fail(error,
                        "the camera has set %s = %s instead of %s; choose a value that the camera "
                        "keeps, or turn its dial to M",
                        name, is ? is : "an unknown value", value);
        g_usleep(AGAIN_US);
    }
}

gboolean setting_set(Camera *camera, GPContext *context, const char *name, const char *value,
                     gint64 deadline_us, GError **error) {
    g_autoptr(Widget) widget = get_widget(camera, context, name);
    g_autofree char *is = widget ? read_value(widget) : NULL;
    int read_only = 0, code;
    if (!widget)
        return fail(error,
                    "the camera has no setting %s; “gphoto2 --list-config” lists its settings",
                    name);
    if (is && setting_text_equal(is, value))
        return TRUE;
    gp_widget_get_readonly(widget, &read_only);
    if (read_only)
        return fail(error,
                    "the camera does not let %s be changed from %s to %s; turn its dial to M", name,
                    is ? is : "an unknown value", value);
    if (!fill(widget, name, value, error)) {
        if (error && !*error)
            fail(error,
                 "libgphoto2 does not accept %s = %s; “gphoto2 --get-config %s” shows what the "
                 "setting takes",
                 name, value, name);
        return FALSE;
    }
    while ((code = gp_camera_set_single_config(camera, name, widget, context)) ==
               GP_ERROR_CAMERA_BUSY &&
           g_get_monotonic_time() < deadline_us)
        g_usleep(AGAIN_US);
    if (code < GP_OK)
        return fail(error,
                    "the camera does not set %s = %s: %s; turn its dial to M, and leave its menu",
                    name, value, gp_result_as_string(code));
    return await(camera, context, name, value, deadline_us, error);
}
