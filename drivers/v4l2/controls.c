#include "controls.h"

#include "drivers/device.h"

#include <errno.h>
#include <math.h>
#include <string.h>

#define EXPOSURE_ABSOLUTE_US 100.0

#define MAX_CONTROLS 512

enum neutral { VALUE, LEAST, HUNDREDTHS, DELIVERED };

static const char curved[] = "values are not proportional to the light";
static const char neighbours[] = "a value depends on the light at neighbouring pixels";
static const char coloured[] = "values depend on the light of other colours";

/* The controls that alter frames, in the order in which they are set: controls that enable others
 * come first. effect is NULL for a control that changes values from frame to frame. A camera that
 * refuses to switch such a control off cannot be used.
 *
 * V4L2 defines no unit for gamma. A range that begins above 0 and includes 100 is taken as
 * hundredths, the unit of UVC. For brightness, contrast, saturation and hue, the default value of
 * the camera is taken as neutral. */
static const struct {
    guint32 id;
    enum neutral neutral;
    int value;
    const char *effect;
} altering[] = {
    {V4L2_CID_SCENE_MODE, VALUE, V4L2_SCENE_MODE_NONE, NULL},
    {V4L2_CID_EXPOSURE_AUTO, VALUE, V4L2_EXPOSURE_MANUAL, NULL},
    /* the exposure must not lower the frame rate */
    {V4L2_CID_EXPOSURE_AUTO_PRIORITY, VALUE, 0, NULL},
    {V4L2_CID_ISO_SENSITIVITY_AUTO, VALUE, V4L2_ISO_SENSITIVITY_MANUAL, NULL},
    {V4L2_CID_AUTOGAIN, VALUE, 0, NULL},
    {V4L2_CID_CHROMA_AGC, VALUE, 0, NULL},
    {V4L2_CID_AUTO_WHITE_BALANCE, VALUE, 0, NULL},
    {V4L2_CID_AUTO_N_PRESET_WHITE_BALANCE, VALUE, V4L2_WHITE_BALANCE_MANUAL, NULL},
    {V4L2_CID_HUE_AUTO, VALUE, 0, NULL},
    {V4L2_CID_AUTOBRIGHTNESS, VALUE, 0, NULL},
    {V4L2_CID_FOCUS_AUTO, VALUE, 0, NULL},
    {V4L2_CID_BACKLIGHT_COMPENSATION, VALUE, 0, NULL},
    {V4L2_CID_WIDE_DYNAMIC_RANGE, VALUE, 0, NULL},
    {V4L2_CID_IMAGE_STABILIZATION, VALUE, 0, NULL},
    {V4L2_CID_GAMMA, HUNDREDTHS, 100, curved},
    {V4L2_CID_SHARPNESS, LEAST, 0, neighbours},
    {V4L2_CID_COLORFX, VALUE, V4L2_COLORFX_NONE, coloured},
    {V4L2_CID_BRIGHTNESS, DELIVERED, 0, curved},
    {V4L2_CID_CONTRAST, DELIVERED, 0, curved},
    {V4L2_CID_SATURATION, DELIVERED, 0, coloured},
    {V4L2_CID_HUE, DELIVERED, 0, coloured},
    {V4L2_CID_TEST_PATTERN, VALUE, 0, "frames do not show what the sensor sees"},
};

static gboolean controls_query(const struct video_node *node, guint32 id,
                               struct v4l2_queryctrl *ret) {
    *ret = (struct v4l2_queryctrl){.id = id};
    return video_ioctl(node, VIDIOC_QUERYCTRL, ret) == 0 && !(ret->flags & V4L2_CTRL_FLAG_DISABLED);
}

static gboolean read_range(const struct video_node *node, guint32 id, struct video_range *ret) {
    struct v4l2_queryctrl control;
    if (!controls_query(node, id, &control) || control.flags & V4L2_CTRL_FLAG_READ_ONLY ||
        control.maximum < control.minimum)
        return FALSE;
    *ret = (struct video_range){id, control.minimum, control.maximum, MAX(control.step, 1)};
    return TRUE;
}

void video_controls_read(const struct video_node *node, struct video_controls *ret) {
    *ret = (struct video_controls){0};
    if (read_range(node, V4L2_CID_EXPOSURE_ABSOLUTE, &ret->exposure))
        ret->exposure_unit_us = EXPOSURE_ABSOLUTE_US;
    else
        read_range(node, V4L2_CID_EXPOSURE, &ret->exposure);
    if (!read_range(node, V4L2_CID_GAIN, &ret->gain))
        read_range(node, V4L2_CID_ANALOGUE_GAIN, &ret->gain);
    read_range(node, V4L2_CID_WHITE_BALANCE_TEMPERATURE, &ret->white_balance);
}

char *video_controls_lacking(const struct video_controls *controls) {
    g_autoptr(GString) text = g_string_new(NULL);
    const struct {
        gboolean has;
        const char *name;
    } wanted[] = {{controls->exposure.id != 0, "exposure"},
                  {controls->gain.id != 0, "gain"},
                  {controls->white_balance.id != 0, "white balance"}};
    for (gsize i = 0; i < G_N_ELEMENTS(wanted); i++)
        if (!wanted[i].has)
            g_string_append_printf(text, "%s%s", text->len ? ", " : "", wanted[i].name);
    return text->len ? g_string_free(g_steal_pointer(&text), FALSE) : NULL;
}

gboolean video_control_set(const struct video_node *node, guint32 id, gint64 value,
                           GError **error) {
    struct v4l2_control set = {id, (gint32)value}, is = {.id = id};
    struct v4l2_queryctrl about;
    gboolean named = controls_query(node, id, &about);
    gboolean hidden =
        about.flags & V4L2_CTRL_FLAG_WRITE_ONLY || about.type == V4L2_CTRL_TYPE_BUTTON;
    /* The message is sent over D-Bus, which requires UTF-8. A camera may send any bytes. */
    g_autofree char *said =
        named ? g_strndup((char *)about.name, sizeof about.name) : g_strdup("a control");
    g_autofree char *name = g_utf8_make_valid(said, -1);
    g_autofree char *what = g_strdup_printf("refused %s = %" G_GINT64_FORMAT, name, value);
    if (video_ioctl(node, VIDIOC_S_CTRL, &set) < 0 ||
        (!hidden && video_ioctl(node, VIDIOC_G_CTRL, &is) < 0))
        return video_set_error(error, node, errno, what);
    return hidden || is.value == value ||
           device_error_set(
               error, DEVICE_ERROR_PROTOCOL, node->who,
               "%s: %s was set to %" G_GINT64_FORMAT ", but is %d" ERROR_ADVICE
               "choose a value that the camera keeps, and end other programs that use the camera",
               node->path, name, value, is.value);
}

/* Converts a name as v4l2-ctl does: "White Balance, Automatic" becomes white_balance_automatic. */
static char *plain_name(const struct v4l2_queryctrl *control) {
    g_autofree char *name = g_strndup((const char *)control->name, sizeof control->name);
    GString *plain = g_string_new(NULL);
    gboolean gap = FALSE;
    for (const char *c = name; *c; c++) {
        if (!g_ascii_isalnum(*c)) {
            gap = TRUE;
            continue;
        }
        if (gap && plain->len)
            g_string_append_c(plain, '_');
        g_string_append_c(plain, g_ascii_tolower(*c));
        gap = FALSE;
    }
    return g_string_free(plain, FALSE);
}

/* Finds the value at which control i of altering[] has no effect. Returns FALSE if no such value is
 * known, or if the value is out of the range of the control. */
static gboolean neutral_value(gsize i, const struct v4l2_queryctrl *control, gint64 *ret) {
    enum neutral neutral = altering[i].neutral;
    *ret = neutral == LEAST       ? MAX(control->minimum, MIN(altering[i].value, control->maximum))
           : neutral == DELIVERED ? control->default_value
                                  : altering[i].value;
    return *ret >= control->minimum && *ret <= control->maximum &&
           (neutral != HUNDREDTHS || control->minimum > 0);
}

gboolean video_controls_by_hand(const struct video_node *node, GError **error) {
    for (gsize i = 0; i < G_N_ELEMENTS(altering); i++) {
        struct v4l2_queryctrl control;
        guint32 passive = V4L2_CTRL_FLAG_READ_ONLY | V4L2_CTRL_FLAG_INACTIVE;
        gint64 value;
        GError *refused = NULL;
        if (!controls_query(node, altering[i].id, &control) || control.flags & passive ||
            !neutral_value(i, &control, &value) ||
            video_control_set(node, altering[i].id, value, &refused))
            continue;
        if (!altering[i].effect ||
            g_error_matches(refused, DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED)) {
            g_propagate_error(error, refused);
            return FALSE;
        }
        g_error_free(refused); /* video_controls_left() reports it */
    }
    return TRUE;
}

static gboolean was_asked_for(char **settings, const char *name) {
    for (; settings && *settings; settings++) {
        g_autofree char *asked = g_strndup(*settings, strcspn(*settings, "="));
        if (strcmp(g_strstrip(asked), name) == 0)
            return TRUE;
    }
    return FALSE;
}

char **video_controls_left(const struct video_node *node, char **settings) {
    g_autoptr(GStrvBuilder) left = g_strv_builder_new();
    for (gsize i = 0; i < G_N_ELEMENTS(altering); i++) {
        struct v4l2_queryctrl control;
        struct v4l2_control is = {.id = altering[i].id};
        gint64 value;
        if (!controls_query(node, altering[i].id, &control) ||
            control.flags & V4L2_CTRL_FLAG_INACTIVE || video_ioctl(node, VIDIOC_G_CTRL, &is) < 0)
            continue;
        gboolean known = neutral_value(i, &control, &value);
        g_autofree char *name = plain_name(&control);
        if ((known && is.value == value) || was_asked_for(settings, name))
            continue;
        g_autofree char *text = g_strdup_printf(
            "%s = %d (%d to %d) cannot be switched off: %s; %s; find out at which value it has no "
            "effect, and write that in controls",
            name, is.value, control.minimum, control.maximum,
            known ? "the camera keeps its value" : "it is not known which value has no effect",
            altering[i].effect ? altering[i].effect
                               : "the same light gives different values from frame to frame");
        g_strv_builder_add(left, text);
    }
    return g_strv_builder_end(left);
}

/* Finds a control by name. If there is none, returns FALSE and appends the names of all controls to
 * `names`. */
static gboolean find_named(const struct video_node *node, const char *name, GString *names,
                           struct v4l2_queryctrl *ret) {
    *ret = (struct v4l2_queryctrl){.id = V4L2_CTRL_FLAG_NEXT_CTRL};
    for (int i = 0; i < MAX_CONTROLS && video_ioctl(node, VIDIOC_QUERYCTRL, ret) == 0; i++) {
        g_autofree char *plain = plain_name(ret);
        guint32 next = ret->id | V4L2_CTRL_FLAG_NEXT_CTRL;
        if (ret->type != V4L2_CTRL_TYPE_CTRL_CLASS && strcmp(plain, name) == 0)
            return TRUE;
        if (ret->type != V4L2_CTRL_TYPE_CTRL_CLASS)
            g_string_append_printf(names, "%s%s", names->len ? ", " : "", plain);
        *ret = (struct v4l2_queryctrl){.id = next};
    }
    return FALSE;
}

gboolean video_control_set_named(const struct video_node *node, const char *setting,
                                 GError **error) {
    g_auto(GStrv) parts = g_strsplit(setting, "=", 2);
    g_autoptr(GString) names = g_string_new(NULL);
    struct v4l2_queryctrl control;
    gint64 value = 0;
    for (int i = 0; parts[0] && parts[i]; i++)
        g_strstrip(parts[i]);
    if (g_strv_length(parts) != 2 ||
        !g_ascii_string_to_signed(parts[1], 10, G_MININT32, G_MAXINT32, &value, NULL))
        return device_error_set(error, DEVICE_ERROR_RANGE, node->who,
                                "controls: \"%s\" does not have the form NAME=NUMBER", setting);
    if (!find_named(node, parts[0], names, &control))
        return device_error_set(error, DEVICE_ERROR_UNSUPPORTED, node->who,
                                "controls: %s has no \"%s\"; it has: %s", node->path, parts[0],
                                names->len ? names->str : "none");
    if (value < control.minimum || value > control.maximum)
        return device_error_set(error, DEVICE_ERROR_RANGE, node->who,
                                "controls: %s = %" G_GINT64_FORMAT " is not within %d to %d",
                                parts[0], value, control.minimum, control.maximum);
    return video_control_set(node, control.id, value, error);
}

gint64 video_range_nearest(const struct video_range *range, double wanted) {
    double steps = round((wanted - (double)range->min) / (double)range->step);
    double most = floor((double)(range->max - range->min) / (double)range->step);
    return range->min + (gint64)CLAMP(steps, 0, most) * range->step;
}
