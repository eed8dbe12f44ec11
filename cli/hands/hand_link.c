#include "hand_link.h"

#include <gio/gunixfdlist.h>
#include <unistd.h>

#include "rig_link.h"

#define MAX_SIDE 65536 /* maximum width and height of a picture in pixels */

char *hand_rig;

/* Handles the property changes that the daemon has sent since it opened or closed the rig. */
static void catch_up(void) {
    while (g_main_context_iteration(NULL, FALSE))
        ;
}

Link *hand_find(char **ret_rig, GError **error) {
    gboolean simulated;
    g_autofree char *rig = hand_rig ? g_canonicalize_filename(hand_rig, NULL) : NULL;
    g_autoptr(Link) link = rig ? rig_link_find(rig, &simulated, error) : link_find(NULL, error);
    if (!link) {
        if (!rig && error && g_error_matches(*error, G_IO_ERROR, G_IO_ERROR_NOT_FOUND))
            g_prefix_error(error, "give --rig RIG, or start the daemon: ");
        return NULL;
    }
    const char *open = bus_rig1_get_rig_path(link_rig(link));
    if (!rig && (!open || !*open)) {
        g_set_error_literal(error, G_IO_ERROR, G_IO_ERROR_NOT_FOUND,
                            "the daemon has no rig open: give --rig RIG");
        return NULL;
    }
    *ret_rig = rig ? g_steal_pointer(&rig) : g_strdup(open);
    return g_steal_pointer(&link);
}

gboolean hand_open(Link *link, const char *rig, GError **error) {
    const gboolean opened = rig_link_open(link, rig, error);
    catch_up();
    return opened;
}

Link *hand_link(GError **error) {
    g_autofree char *rig = NULL;
    g_autoptr(Link) link = hand_find(&rig, error);
    return link && hand_open(link, rig, error) ? g_steal_pointer(&link) : NULL;
}

gboolean hand_begin_recording(Link *link, const char *rig, gboolean *was_open, GError **error) {
    BusRig1 *object = link_rig(link);
    const char *open = bus_rig1_get_rig_path(object);
    *was_open = g_strcmp0(open, rig) == 0;
    if (*was_open && !bus_rig1_call_close_rig_sync(object, NULL, error))
        return FALSE;
    if (!bus_rig1_call_begin_recording_sync(object, NULL, error))
        return FALSE;
    catch_up();
    return hand_open(link, rig, error);
}

/* Reads a file that the daemon has sent. */
static char *read_text(int fd, GError **error) {
    g_autoptr(GString) text = g_string_new(NULL);
    char bytes[65536];
    gssize n;
    while ((n = pread(fd, bytes, sizeof bytes, (off_t)text->len)) > 0)
        g_string_append_len(text, bytes, n);
    close(fd);
    if (n == 0)
        return g_string_free(g_steal_pointer(&text), FALSE);
    g_set_error_literal(error, G_IO_ERROR, G_IO_ERROR_PARTIAL_INPUT,
                        "the recording of mesorigd cannot be read: make it again");
    return NULL;
}

char *hand_end_recording(Link *link, const char *rig, gboolean was_open, GError **error) {
    BusRig1 *object = link_rig(link);
    g_autoptr(GVariant) handle = NULL;
    g_autoptr(GUnixFDList) list = NULL;
    catch_up();
    const char *open = bus_rig1_get_rig_path(object);
    if (open && *open && !bus_rig1_call_close_rig_sync(object, NULL, error))
        return NULL;
    if (!bus_rig1_call_end_recording_sync(object, NULL, &handle, &list, NULL, error))
        return NULL;
    const int fd = list ? g_unix_fd_list_get(list, g_variant_get_handle(handle), error) : -1;
    g_autofree char *text = fd >= 0 ? read_text(fd, error) : NULL;
    catch_up();
    if (!text || (was_open && !hand_open(link, rig, error)))
        return NULL;
    return g_steal_pointer(&text);
}

static gboolean read_pixels(int fd, Frame *frame, GError **error) {
    const gsize size = (gsize)frame->width * (gsize)frame->height * sizeof(guint16);
    gsize done = 0;
    while (done < size) {
        const gssize n = pread(fd, (guint8 *)frame->pixels + done, size - done, (off_t)done);
        if (n <= 0) {
            g_set_error(error, G_IO_ERROR, G_IO_ERROR_PARTIAL_INPUT,
                        "mesorigd sent only %zu of the picture's %zu bytes: take the picture again",
                        done, size);
            return FALSE;
        }
        done += (gsize)n;
    }
    return TRUE;
}

Frame *hand_snap(Link *link, const char *camera, gint64 exposure_us, double gain_db,
                 GError **error) {
    guint width, height, bits;
    double black;
    gint64 exposed_us;
    enum cfa cfa;
    g_autofree char *filter = NULL;
    g_autoptr(GVariant) handle = NULL;
    g_autoptr(GUnixFDList) list = NULL;
    hand_renew(link, HAND_LEASE_S);
    if (!bus_rig1_call_snap_sync(link_rig(link), camera, exposure_us, gain_db, NULL, &width,
                                 &height, &bits, &black, &filter, &exposed_us, &handle, &list, NULL,
                                 error))
        return NULL;
    const int fd = list ? g_unix_fd_list_get(list, g_variant_get_handle(handle), error) : -1;
    if (fd < 0)
        return NULL;
    g_autoptr(Frame) frame = NULL;
    if (width < 1 || height < 1 || width > MAX_SIDE || height > MAX_SIDE || bits < 1 || bits > 16 ||
        !cfa_parse(filter, &cfa)) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_DATA,
                    "mesorigd sent a picture of an unknown form (%u × %u pixels of %u bits, colour "
                    "filter %s): run mesorig and mesorigd of the same version",
                    width, height, bits, filter);
    } else {
        frame = frame_new((int)width, (int)height);
        frame->bits = (int)bits;
        frame->black_level = black;
        frame->cfa = cfa;
        frame->exposure_us = exposed_us;
    }
    const gboolean good = frame && read_pixels(fd, frame, error);
    close(fd);
    return good ? g_steal_pointer(&frame) : NULL;
}

void hand_renew(Link *link, double for_s) {
    bus_rig1_call_renew(link_rig(link), for_s, NULL, NULL, NULL);
}

struct renewal {
    Link *link;
    double for_s;
};

static gboolean on_renew(gpointer data) {
    const struct renewal *renewal = data;
    hand_renew(renewal->link, renewal->for_s);
    return G_SOURCE_CONTINUE;
}

static void take_result(GObject *source, GAsyncResult *result, gpointer data) {
    *(GAsyncResult **)data = g_object_ref(result);
}

static gboolean switch_light(Link *link, gboolean laser, const char *name, gboolean on,
                             double for_s, GError **error) {
    BusRig1 *rig = link_rig(link);
    g_autoptr(GAsyncResult) result = NULL;
    struct renewal renewal = {link, for_s};
    const guint timer = g_timeout_add((guint)MAX(for_s * 1000 / 3, 10), on_renew, &renewal);
    if (laser)
        bus_rig1_call_set_laser(rig, name, on, for_s, NULL, take_result, &result);
    else
        bus_rig1_call_set_lamp(rig, name, on, for_s, NULL, take_result, &result);
    while (!result)
        g_main_context_iteration(NULL, TRUE);
    g_source_remove(timer);
    return laser ? bus_rig1_call_set_laser_finish(rig, result, error)
                 : bus_rig1_call_set_lamp_finish(rig, result, error);
}

gboolean hand_light(Link *link, gboolean laser, const char *name, gboolean on, GError **error) {
    return switch_light(link, laser, name, on, HAND_LEASE_S, error);
}

gboolean hand_light_for(Link *link, gboolean laser, const char *name, double for_s,
                        GError **error) {
    return switch_light(link, laser, name, TRUE, for_s, error);
}

gboolean hand_move(Link *link, const char *axis, double deg, double *ret_deg, GError **error) {
    return bus_rig1_call_move_axis_sync(link_rig(link), axis, deg, ret_deg, NULL, error);
}

gboolean hand_home(Link *link, const char *axis, double *ret_deg, GError **error) {
    return bus_rig1_call_home_axis_sync(link_rig(link), axis, ret_deg, NULL, error);
}
