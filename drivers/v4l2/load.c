#include "load.h"

#include "drivers/device.h"

#include <string.h>

struct video_load {
    char *who;
    /* Sysfs folders of USB devices. Each folder stands for the link from that device towards the
     * computer. */
    GPtrArray *links;
    double mb_s;
};

static GList *loads;

/*
 * Periodic transfers may take 90 % of a full-speed frame, 80 % of a high-speed microframe and 90 %
 * of a SuperSpeed bus interval (USB 2.0, 5.6.4 and 5.7.4; USB 3.2, 4.4.7). At high speed, a packet
 * of 1024 bytes has about 38 bytes of protocol. SuperSpeed sends ten bits per byte (132 bits for
 * 128 from 10 Gbit/s on) and about 40 bytes of protocol per packet.
 */
double video_link_mb_s(double mbit_s) {
    double mb_s = mbit_s / 8;
    if (mbit_s < 480)
        return mb_s * 0.9 * 1023 / (1023 + 9);
    if (mbit_s < 5000)
        return mb_s * 0.8 * 1024 / (1024 + 38);
    return mb_s * (mbit_s < 10000 ? 0.8 : 128.0 / 132) * 0.9 * 1024 / (1024 + 40);
}

static double read_speed(const char *folder) {
    g_autofree char *path = g_build_filename(folder, "speed", NULL);
    g_autofree char *text = NULL;
    if (!g_file_get_contents(path, &text, NULL, NULL))
        return 0;
    double mbit_s = g_ascii_strtod(text, NULL);
    return mbit_s > 0 && mbit_s < 1e6 ? mbit_s : 0;
}

static gboolean load_check_link(const char *link, const struct video_load *new, GError **error) {
    g_autoptr(GString) who = g_string_new(NULL);
    double speed = read_speed(link), most = video_link_mb_s(speed), sum = new->mb_s;
    for (GList *l = loads; l; l = l->next) {
        const struct video_load *load = l->data;
        if (!g_ptr_array_find_with_equal_func(load->links, link, g_str_equal, NULL))
            continue;
        sum += load->mb_s;
        g_string_append_printf(who, "%s, ", load->who);
    }
    if (sum <= most)
        return TRUE;
    g_autofree char *name = g_path_get_basename(link);
    if (who->len == 0)
        return device_error_set(error, DEVICE_ERROR_UNSUPPORTED, new->who,
                                "it sends %.1f MB/s, more than the %.1f MB/s that the USB link %s "
                                "of %.0f Mbit/s carries" ERROR_ADVICE
                                "lower frame_rate, choose a format of fewer bytes or smaller "
                                "frames, or plug the camera into a faster port",
                                sum, most, name, speed);
    return device_error_set(
        error, DEVICE_ERROR_UNSUPPORTED, new->who,
        "%s%s together send %.1f MB/s, more than the %.1f MB/s that the USB link %s "
        "of %.0f Mbit/s carries" ERROR_ADVICE
        "lower frame_rate, choose a format of fewer bytes or smaller frames, or "
        "plug some of these cameras into another controller",
        who->str, new->who, sum, most, name, speed);
}

gboolean video_load_add(const char *who, const char *sysfs, double mb_s, struct video_load **ret,
                        GError **error) {
    struct video_load *load = g_new0(struct video_load, 1);
    gboolean ok = TRUE;
    *ret = NULL;
    load->who = g_strdup(who);
    load->links = g_ptr_array_new_with_free_func(g_free);
    load->mb_s = mb_s;
    /* Add the links of the camera itself, of the hubs above it, and of the root hub. */
    for (char *folder = g_strdup(sysfs); folder;) {
        char *parent = strlen(folder) > 1 ? g_path_get_dirname(folder) : NULL;
        if (read_speed(folder) > 0)
            g_ptr_array_add(load->links, folder);
        else
            g_free(folder);
        folder = parent;
    }
    for (guint i = 0; ok && i < load->links->len; i++)
        ok = load_check_link(load->links->pdata[i], load, error);
    if (!ok || load->links->len == 0) {
        video_load_remove(load);
        return ok;
    }
    loads = g_list_append(loads, load);
    *ret = load;
    return TRUE;
}

void video_load_remove(struct video_load *load) {
    if (!load)
        return;
    loads = g_list_remove(loads, load);
    g_ptr_array_unref(load->links);
    g_free(load->who);
    g_free(load);
}
