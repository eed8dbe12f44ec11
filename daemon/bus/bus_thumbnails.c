#include "bus_errors.h"
#include "bus_private.h"

#include <string.h>

#define THUMBNAIL_INTERVAL_US (1 * G_USEC_PER_SEC)

void bus_show_thumbnails(Bus *bus) {
    const gint64 now_us = g_get_monotonic_time();
    for (int i = 0; i < bus->devices->geometry.n_cameras; i++) {
        if (now_us < bus->thumbnail_sent_us[i] + THUMBNAIL_INTERVAL_US)
            continue; /* before the thumbnail is made, which costs most */
        const struct capture_thumbnail *thumbnail = capture_thumbnail(bus->capture, i);
        if (!thumbnail || thumbnail->time_s == bus->thumbnail_time_s[i])
            continue;
        bus->thumbnail_time_s[i] = thumbnail->time_s;
        bus->thumbnail_sent_us[i] = now_us;
        bus_rig1_emit_thumbnail_changed(bus->object, bus->devices->geometry.cameras[i].name);
    }
}

void bus_drop_thumbnails(Bus *bus) {
    for (int i = 0; i < RIG_MAX_CAMERAS; i++) {
        g_free(bus->kept[i].rgb);
        bus->kept[i] = (struct capture_thumbnail){0};
    }
}

void bus_keep_thumbnails(Bus *bus) {
    bus_drop_thumbnails(bus);
    for (int i = 0; i < bus->devices->geometry.n_cameras; i++) {
        const struct capture_thumbnail *last = capture_thumbnail(bus->capture, i);
        if (!last)
            continue;
        bus->kept[i] = *last;
        bus->kept[i].rgb = g_memdup2(last->rgb, (gsize)last->width * (gsize)last->height * 3);
    }
}

const struct capture_thumbnail *bus_thumbnail(Bus *bus, const char *camera, GError **error) {
    g_autoptr(GString) names = g_string_new(NULL);
    int index = 0;
    if (!bus_need_rig(bus, error))
        return NULL;
    const struct rig *rig = &bus->devices->geometry;
    for (; index < rig->n_cameras && strcmp(rig->cameras[index].name, camera) != 0; index++)
        g_string_append_printf(names, "%s%s", index ? ", " : "", rig->cameras[index].name);
    if (index == rig->n_cameras) {
        g_set_error(error, BUS_ERROR, BUS_ERROR_UNKNOWN, "no camera “%s”: there are %s", camera,
                    names->str);
        return NULL;
    }
    if (!bus->capture && bus->kept[index].rgb)
        return &bus->kept[index];
    if (!bus_need_capture(bus, error))
        return NULL;
    const struct capture_thumbnail *found = capture_thumbnail(bus->capture, index);
    if (!found)
        g_set_error(error, BUS_ERROR, BUS_ERROR_NO_PICTURE,
                    "camera %s has not taken a picture in this capture yet: try again later",
                    camera);
    return found;
}
