#include "v4l2.h"

#include "controls.h"

#include <string.h>

static char *make_section(const struct video_node *node, const struct video_format *format,
                          const struct video_controls *controls, gboolean by_bus) {
    GString *section = g_string_new("[camera NAME]\ndriver = v4l2-camera\n");
    g_autofree char *fourcc = video_fourcc_name(format->fourcc);
    g_string_append_printf(section, by_bus ? "bus = %s\n" : "device = %s\n",
                           by_bus ? node->bus : node->path);
    g_string_append_printf(section, "format = %s\n", fourcc);
    struct video_pix pix;
    struct v4l2_streamparm parm = {.type = node->type};
    const struct v4l2_fract *interval = &parm.parm.capture.timeperframe;
    if (video_node_get_pix(node, &pix) == 0)
        g_string_append_printf(section, "width = %u\nheight = %u\n", pix.width, pix.height);
    if (video_ioctl(node, VIDIOC_G_PARM, &parm) == 0 && interval->numerator > 0) {
        char rate[G_ASCII_DTOSTR_BUF_SIZE];
        g_ascii_formatd(rate, sizeof rate, "%.6g",
                        (double)interval->denominator / interval->numerator);
        g_string_append_printf(section, "frame_rate = %s\n", rate);
    }
    if (controls->exposure.id == 0)
        g_string_append(section, "# fixed_exposure_us = exposure time from its data sheet\n");
    else if (controls->exposure_unit_us == 0)
        g_string_append(section,
                        "# exposure_unit_us = duration of a step of its exposure control\n");
    return g_string_free(section, FALSE);
}

static void scan_describe(const struct video_node *node, const GPtrArray *nodes,
                          struct found *found) {
    g_autoptr(GArray) offered = video_node_formats(node);
    const struct video_format *format = NULL; /* the format that would be used */
    struct video_controls controls;
    int n_on_bus = 0;
    for (guint i = 0; i < offered->len; i++)
        format = video_format_better(format, video_format_find(g_array_index(offered, guint32, i)));
    if (!format) {
        found->note =
            g_strdup("offers only compressed frames, which cannot be used to measure light");
        return;
    }
    video_controls_read(node, &controls);
    g_autofree char *lacking = video_controls_lacking(&controls);
    g_autofree char *sizes = video_node_sizes(node, format->fourcc);
    for (guint i = 0; i < nodes->len; i++) {
        struct video_node other;
        if (video_node_open(&other, "", nodes->pdata[i], NULL, NULL))
            n_on_bus += strcmp(other.bus, node->bus) == 0;
        video_node_close(&other);
    }
    found->section = make_section(node, format, &controls, n_on_bus <= 1);
    g_autoptr(GString) note = g_string_new(NULL);
    if (*sizes)
        g_string_append_printf(note, "frames of %s", sizes);
    if (lacking)
        g_string_append_printf(note, "%sno control for: %s", note->len ? "; " : "", lacking);
    found->note = note->len ? g_strdup(note->str) : NULL;
}

gboolean v4l2_scan(GPtrArray *to, GError **error) {
    g_autoptr(GPtrArray) nodes = video_node_list();
    for (guint i = 0; i < nodes->len; i++) {
        struct video_node node;
        g_autoptr(GError) why = NULL;
        gboolean opened = video_node_open(&node, "it", nodes->pdata[i], NULL, &why);
        struct found *found =
            found_add(to, "video", nodes->pdata[i], opened ? node.card : "a camera", NULL);
        if (opened)
            scan_describe(&node, nodes, found);
        else
            found->note = g_strdup(why->message);
        video_node_close(&node);
    }
    return TRUE;
}
