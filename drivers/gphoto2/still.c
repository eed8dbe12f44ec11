#include "still.h"

#include "setting.h"
#include "setting_text.h"

#include "pictures/raw.h"

#include <gio/gio.h>
#include <gphoto2/gphoto2-setting.h>

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <string.h>
#include <unistd.h>

#define EVENT_MS 10 /* time that the library may wait for an event; over PTP/IP it waits 1 ms */
#define PAUSE_MS 5
/* Longest normal time from one look for events to the next, with the pause between them. */
#define MAX_PASS_US  (2 * (EVENT_MS + PAUSE_MS) * 1000)
#define MAX_IDLE     32 /* largest number of events that are taken while nothing is asked */
#define SETTING_US   (2 * G_USEC_PER_SEC)
#define BATTERY_US   (60 * G_USEC_PER_SEC) /* time between two looks at the battery */
#define MIN_BATTERY  5                     /* percent */
#define MIN_CARD_KB  1024
#define COMPANION_US (G_USEC_PER_SEC / 2) /* shortest time to wait for a raw file after a JPEG */
#define DATE_US      (3 * G_USEC_PER_SEC) /* largest error of the date of a file */
/* time before the deadline that is left for a look at the card */
#define LOOK_US     G_USEC_PER_SEC
#define USB_DEVICES "/sys/bus/usb/devices"
#define PTPIP_MODEL "PTP/IP Camera"

struct exposure {
    gint64 us;
    char *text; /* as the camera offers it */
};

struct Still {
    const struct still_options *options;
    const char *shutter;
    GPContext *context;
    CameraAbilitiesList *abilities;
    Camera *camera; /* NULL if there is no connection */
    char *said;     /* last error message of the library */
    char *model, *serial;
    GArray *exposures;    /* of struct exposure */
    GArray *exposures_us; /* of gint64 */
    GHashTable *known;    /* paths of the files on the card that are no new pictures */
    gboolean is_first;    /* no picture was taken yet, so raw is not known */
    gboolean raw;         /* pictures are raw files */
    /* Difference between the camera's clock and ours, from the first picture. A file that was found
     * on the card is only taken or removed if the camera dates it to the shot, because somebody may
     * have exchanged the card. */
    gint64 clock_us;
    gboolean has_clock;
    gboolean abandoned;        /* the picture of a shot that was given up may still come */
    gint64 abandoned_us;       /* time of that shot */
    gint64 abandoned_until_us; /* time until which that picture may come */
    char *stem;        /* name of the last picture without its extension; NULL if there is none */
    gint64 battery_us; /* time of the last look at the battery; 0: look at the next shot */
};

typedef CameraList Names;
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Names, gp_list_unref)
typedef GPPortInfoList Ports;
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Ports, gp_port_info_list_free)
typedef CameraFile File;
G_DEFINE_AUTOPTR_CLEANUP_FUNC(File, gp_file_unref)

static gint64 now_us(void) {
    return g_get_monotonic_time();
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

static void on_library_error(GPContext *context, const char *text, void *data) {
    Still *still = data;
    g_free(still->said);
    still->said = g_strstrip(g_strdup(text));
}

/* Returns what the library has said since begin_call(), or else its text for the code. */
static const char *reason(const Still *still, int code) {
    return still->said && *still->said ? still->said : gp_result_as_string(code);
}

/* Forgets the message of an earlier call. */
static void begin_call(Still *still) {
    g_clear_pointer(&still->said, g_free);
}

static char *read_attribute(const char *place, const char *name) {
    g_autofree char *path = g_build_filename(USB_DEVICES, place, name, NULL);
    char *text = NULL;
    return g_file_get_contents(path, &text, NULL, NULL) ? g_strstrip(text) : NULL;
}

/* Returns the port of libgphoto2 for a place on USB: "usb:001,005" for "1-2.4". Returns NULL if
 * nothing is plugged in there. */
static char *port_of_place(const char *place) {
    g_autofree char *bus = read_attribute(place, "busnum");
    g_autofree char *device = read_attribute(place, "devnum");
    return bus && device ? g_strdup_printf("usb:%03d,%03d", atoi(bus), atoi(device)) : NULL;
}

/* Returns the place on USB that has a port of libgphoto2. Returns the port itself if it is not on
 * USB. */
static char *place_of_port(const char *port) {
    g_autoptr(GDir) dir = g_dir_open(USB_DEVICES, 0, NULL);
    for (const char *place; dir && (place = g_dir_read_name(dir));) {
        g_autofree char *of_place = strchr(place, ':') ? NULL : port_of_place(place);
        if (g_strcmp0(of_place, port) == 0)
            return g_strdup(place);
    }
    return g_strdup(port);
}

static Names *detect(const Still *still, Ports *ports) {
    Names *found = NULL;
    gp_list_new(&found);
    gp_abilities_list_detect(still->abilities, ports, found, still->context);
    return found;
}

static const char *found_port(Names *found, int i) {
    const char *port = NULL;
    gp_list_get_value(found, i, &port);
    return port;
}

static const char *found_model(Names *found, int i) {
    const char *model = NULL;
    gp_list_get_name(found, i, &model);
    return model;
}

/* Finds the only camera on USB. */
static gboolean find_only(Names *found, char **ret_port, GError **error) {
    const int n = gp_list_count(found);
    if (n == 1) {
        *ret_port = g_strdup(found_port(found, 0));
        return TRUE;
    }
    g_autoptr(GString) names = g_string_new(NULL);
    for (int i = 0; i < n; i++) {
        g_autofree char *place = place_of_port(found_port(found, i));
        g_string_append_printf(names, "%s%s (%s)", i ? ", " : "", place, found_model(found, i));
    }
    if (n > 1)
        return fail(error, "there are several cameras on USB: %s; choose one with the key port",
                    names->str);
    return fail(error,
                "no camera was found on USB; connect it, switch it on, and see that no other "
                "program has opened it");
}

/* Finds port and model of the camera. Free them with g_free(). */
static gboolean find(const Still *still, Ports *ports, char **ret_port, char **ret_model,
                     GError **error) {
    const struct still_options *options = still->options;
    const char *wanted = options->port;
    g_autoptr(Names) found = NULL;
    g_autofree char *port = NULL;
    if (g_str_has_prefix(wanted, "usb") || g_ascii_isdigit(*wanted))
        found = detect(still, ports);
    if (g_str_equal(wanted, "usb")) {
        if (!find_only(found, &port, error))
            return FALSE;
    } else if (g_ascii_isdigit(*wanted)) {
        port = port_of_place(wanted);
        if (!port)
            return fail(error, "nothing is plugged in at %s; “mesorig devices” lists the cameras",
                        wanted);
    } else {
        port = g_strdup(wanted);
    }
    const char *model = g_str_has_prefix(port, "ptpip:") ? PTPIP_MODEL : NULL;
    for (int i = 0; found && i < gp_list_count(found); i++)
        if (g_strcmp0(found_port(found, i), port) == 0)
            model = found_model(found, i);
    if (options->model)
        model = options->model;
    if (!model)
        return fail(
            error,
            "libgphoto2 does not recognise the camera at %s; give its name with the key model",
            wanted);
    *ret_model = g_strdup(model);
    *ret_port = g_steal_pointer(&port);
    return TRUE;
}

/* libgphoto2 2.5.30 closes descriptor 0 at the end of a PTP/IP connection, as if it was a third
 * connection. /dev/null takes its place, so that no other file gets this number. */
static void hold_descriptor(void) {
    if (fcntl(STDIN_FILENO, F_GETFD) < 0 && open("/dev/null", O_RDONLY | O_CLOEXEC) != STDIN_FILENO)
        g_printerr("mesorig-gphoto2: /dev/null: %s\n", g_strerror(errno));
}

static gboolean attach(Still *still, Ports *ports, const char *port, const char *model,
                       GError **error) {
    CameraAbilities abilities;
    GPPortInfo info;
    const int at = gp_abilities_list_lookup_model(still->abilities, model);
    const int port_at = gp_port_info_list_lookup_path(ports, port);
    if (at < GP_OK || gp_abilities_list_get_abilities(still->abilities, at, &abilities) < GP_OK)
        return fail(
            error,
            "libgphoto2 has no camera of the name “%s”; “gphoto2 --list-cameras” lists the names",
            model);
    if (port_at < GP_OK || gp_port_info_list_get_info(ports, port_at, &info) < GP_OK)
        return fail(error, "libgphoto2 has no port “%s”; “gphoto2 --list-ports” lists the ports",
                    port);
    gp_camera_new(&still->camera);
    gp_camera_set_abilities(still->camera, abilities);
    gp_camera_set_port_info(still->camera, info);
    begin_call(still);
    const int code = gp_camera_init(still->camera, still->context);
    if (code >= GP_OK)
        return TRUE;
    fail(error,
         "the camera at %s cannot be opened: %s; switch it on, and see that no other program "
         "(gvfs, a photo program) has opened it",
         port, reason(still, code));
    g_clear_pointer(&still->camera, gp_camera_unref);
    hold_descriptor();
    return FALSE;
}

static void disconnect(Still *still) {
    if (!still->camera)
        return;
    gp_camera_exit(still->camera, still->context);
    g_clear_pointer(&still->camera, gp_camera_unref);
    hold_descriptor();
}

static gboolean still_connect(Still *still, GError **error) {
    g_autoptr(Ports) ports = NULL;
    g_autofree char *port = NULL, *model = NULL;
    disconnect(still);
    gp_port_info_list_new(&ports);
    gp_port_info_list_load(ports);
    return find(still, ports, &port, &model, error) && attach(still, ports, port, model, error);
}

static char *path_text(const CameraFilePath *path) {
    return g_build_filename(path->folder, path->name, NULL);
}

/* Returns whether a file is only in the camera's memory. The library puts such files into the root
 * folder, names them capt0000 and so on, and begins to count again with each connection. */
static gboolean is_in_memory(const CameraFilePath *path) {
    return strcmp(path->folder, "/") == 0;
}

/* Removes a file from the card, unless pictures are to stay there. A removed file is no longer
 * known, because a later picture may have the same name. */
static void remove_file(Still *still, const CameraFilePath *path) {
    g_autofree char *text = path_text(path);
    if (still->options->keep_on_card && !is_in_memory(path))
        return;
    begin_call(still);
    const int code = gp_camera_file_delete(still->camera, path->folder, path->name, still->context);
    if (code >= GP_OK)
        g_hash_table_remove(still->known, text);
    else
        g_printerr("mesorig-gphoto2: %s stays on the card: %s\n", text, reason(still, code));
}

/* Appends the files of a folder and of its subfolders that are not known yet, and makes them
 * known. */
static gboolean find_new(Still *still, const char *folder, GArray *to, GError **error) {
    g_autoptr(Names) names = NULL, folders = NULL;
    gp_list_new(&names);
    gp_list_new(&folders);
    begin_call(still);
    int code = gp_camera_folder_list_files(still->camera, folder, names, still->context);
    if (code >= GP_OK)
        code = gp_camera_folder_list_folders(still->camera, folder, folders, still->context);
    if (code < GP_OK)
        return fail(
            error,
            "the folder %s of the camera's card cannot be read: %s; check the card and the cable",
            folder, reason(still, code));
    for (int i = 0; i < gp_list_count(names); i++) {
        CameraFilePath path = {0};
        g_strlcpy(path.folder, folder, sizeof path.folder);
        g_strlcpy(path.name, found_model(names, i), sizeof path.name);
        if (g_hash_table_add(still->known, path_text(&path)))
            g_array_append_val(to, path);
    }
    for (int i = 0; i < gp_list_count(folders); i++) {
        g_autofree char *inner = g_build_filename(folder, found_model(folders, i), NULL);
        if (!find_new(still, inner, to, error))
            return FALSE;
    }
    return TRUE;
}

static char *stem_of(const char *name) {
    const char *dot = strrchr(name, '.');
    return dot ? g_strndup(name, (gsize)(dot - name)) : g_strdup(name);
}

/* Returns whether a new file is the picture of a shot. If the pictures of this camera are raw
 * files, removes a JPEG and returns FALSE. */
static gboolean is_picture(Still *still, const CameraFilePath *path) {
    if (still->is_first || raw_is(path->name) || !still->raw)
        return TRUE;
    remove_file(still, path);
    return FALSE;
}

/* Returns the date that the camera gives a file, by the camera's clock. Returns 0 if there is no
 * date. */
static gint64 date_us(Still *still, const CameraFilePath *path) {
    CameraFileInfo info = {0};
    if (gp_camera_file_get_info(still->camera, path->folder, path->name, &info, still->context) <
            GP_OK ||
        !(info.file.fields & GP_FILE_INFO_MTIME))
        return 0;
    return (gint64)info.file.mtime * G_USEC_PER_SEC;
}

/* Returns whether a file was made by a shot at begin_us. Returns TRUE for the first picture,
 * because there is no date to compare with. */
static gboolean is_of_shot(Still *still, const CameraFilePath *path, gint64 begin_us) {
    if (still->is_first)
        return TRUE;
    const gint64 us = date_us(still, path);
    return still->has_clock && us > 0 && us - still->clock_us >= begin_us - DATE_US;
}

/* Connects the camera again and looks for pictures of a shot at begin_us on its card. Returns them,
 * or NULL with an error. */
static GArray *look_again(Still *still, gint64 begin_us, GError **error) {
    if (!still_connect(still, error))
        return NULL;
    g_autoptr(GArray) found = g_array_new(FALSE, FALSE, sizeof(CameraFilePath));
    if (!find_new(still, "/", found, error)) {
        disconnect(still);
        return NULL;
    }
    for (guint i = 0; i < found->len; i++) {
        const CameraFilePath *path = &g_array_index(found, CameraFilePath, i);
        if (!is_of_shot(still, path, begin_us) || !is_picture(still, path))
            g_array_remove_index(found, i--);
    }
    return g_steal_pointer(&found);
}

enum happening { NOTHING, PICTURE, COMPLETE, FULL, OTHER, LOST };

/* Takes the next event. */
static enum happening next_event(Still *still, CameraFilePath *ret) {
    CameraEventType type = GP_EVENT_UNKNOWN;
    void *data = NULL;
    begin_call(still);
    const int code =
        gp_camera_wait_for_event(still->camera, EVENT_MS, &type, &data, still->context);
    g_autofree void *owned = data;
    if (code < GP_OK)
        return LOST;
    switch (type) {
    case GP_EVENT_FILE_ADDED: {
        *ret = *(CameraFilePath *)data;
        const gboolean is_new = is_in_memory(ret) || g_hash_table_add(still->known, path_text(ret));
        return is_new && is_picture(still, ret) ? PICTURE : OTHER;
    }
    case GP_EVENT_CAPTURE_COMPLETE:
        return COMPLETE;
    case GP_EVENT_UNKNOWN: /* the library does not name the event StoreFull of PTP */
        return data && g_str_has_prefix(data, "PTP Event 400a") ? FULL : OTHER;
    case GP_EVENT_TIMEOUT:
        return NOTHING;
    default:
        return OTHER;
    }
}

/* Returns whether the card has no room for another picture. */
static gboolean card_is_full(Still *still) {
    CameraStorageInformation *stores = NULL;
    int n = 0;
    gboolean full = FALSE;
    if (!still->camera ||
        gp_camera_get_storageinfo(still->camera, &stores, &n, still->context) < GP_OK)
        return FALSE;
    for (int i = 0; i < n; i++) {
        const gboolean counted = stores[i].fields & GP_STORAGEINFO_FREESPACEIMAGES;
        const gboolean measured = stores[i].fields & GP_STORAGEINFO_FREESPACEKBYTES;
        full = (counted && stores[i].freeimages == 0) ||
               (measured && stores[i].freekbytes < MIN_CARD_KB);
        if (!full)
            break;
    }
    free(stores);
    return full;
}

static gboolean check_card(Still *still, GError **error) {
    return !card_is_full(still) ||
           fail(error, "the card of the camera is full; copy the pictures and format the card");
}

static gboolean check_battery(Still *still, GError **error) {
    if (still->battery_us > 0 && now_us() - still->battery_us < BATTERY_US)
        return TRUE;
    g_autofree char *level = setting_get(still->camera, still->context, "batterylevel");
    const double percent = level ? setting_text_number(level) : -1;
    still->battery_us = now_us();
    if (percent < 0 || percent > MIN_BATTERY)
        return TRUE;
    still->battery_us = 0;
    return fail(error, "the battery of the camera is at %g %%; charge it, or use a mains adapter",
                percent);
}

static gboolean set(Still *still, const char *name, const char *value, GError **error) {
    return setting_set(still->camera, still->context, name, value, now_us() + SETTING_US, error);
}

static gboolean has(const Still *still, const char *name) {
    g_autofree char *value = setting_get(still->camera, still->context, name);
    return value != NULL;
}

/* Sets the options. Makers have two names for the aperture. */
static gboolean apply(Still *still, GError **error) {
    const struct still_options *options = still->options;
    for (const char *const *s = options->settings; s && *s; s++) {
        g_auto(GStrv) parts = g_strsplit(*s, "=", 2);
        if (!parts[0] || !parts[1])
            return fail(error,
                        "the setting “%s” is not NAME=VALUE; correct the settings in the rig file",
                        *s);
        if (!set(still, g_strstrip(parts[0]), g_strstrip(parts[1]), error))
            return FALSE;
    }
    const char *aperture = has(still, "f-number") ? "f-number" : "aperture";
    return (!options->iso || set(still, "iso", options->iso, error)) &&
           (!options->aperture || set(still, aperture, options->aperture, error));
}

static int compare_exposures(gconstpointer a, gconstpointer b) {
    const struct exposure *x = a, *y = b;
    return x->us < y->us ? -1 : x->us > y->us;
}

static void clear_exposure(gpointer data) {
    g_free(((struct exposure *)data)->text);
}

static gboolean list_exposures(Still *still, GError **error) {
    g_auto(GStrv) choices = setting_choices(still->camera, still->context, still->shutter);
    for (char **choice = choices; choice && *choice; choice++) {
        const double s = setting_text_number(*choice);
        if (s > 0 && s <= 3600)
            g_array_append_val(still->exposures,
                               ((struct exposure){llround(s * 1e6), g_strdup(*choice)}));
    }
    g_array_sort(still->exposures, compare_exposures);
    for (guint i = 0; i < still->exposures->len; i++)
        g_array_append_val(still->exposures_us,
                           g_array_index(still->exposures, struct exposure, i).us);
    return still->exposures->len > 0 ||
           fail(
               error,
               "the camera offers no exposure times in the setting %s; turn its dial to M, or name "
               "the setting with shutter",
               still->shutter);
}

/* Returns the serial number without the zeros before it. */
static char *read_serial(Still *still) {
    g_autofree char *serial = setting_get(still->camera, still->context, "serialnumber");
    const char *digits = serial ? serial + strspn(serial, "0 ") : "";
    return g_strdup(*digits || !serial ? digits : serial);
}

static char *read_model(Still *still) {
    g_autofree char *maker = setting_get(still->camera, still->context, "manufacturer");
    g_autofree char *model = setting_get(still->camera, still->context, "cameramodel");
    if (!model)
        return g_strdup("camera");
    return maker && !g_str_has_prefix(model, maker) ? g_strdup_printf("%s %s", maker, model)
                                                    : g_steal_pointer(&model);
}

/* Makes the library read a setting from the camera each time it is asked. Without this call, it
 * returns values of up to 2 s ago, even if the camera reports a change during a transfer. The
 * library stores this in its own file of settings. */
static void forbid_cache(void) {
    char is[1024]; /* the library asks for this size */
    char name[] = "ptp2", key[] = "cachetime", value[] = "0";
    if (gp_setting_get(name, key, is) < GP_OK || strcmp(is, value) != 0)
        gp_setting_set(name, key, value);
}

static Still *still_new(const struct still_options *options) {
    Still *still = g_new0(Still, 1);
    still->options = options;
    still->shutter = options->shutter ? options->shutter : "shutterspeed";
    still->is_first = TRUE;
    still->exposures = g_array_new(FALSE, FALSE, sizeof(struct exposure));
    g_array_set_clear_func(still->exposures, clear_exposure);
    still->exposures_us = g_array_new(FALSE, FALSE, sizeof(gint64));
    still->known = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, NULL);
    forbid_cache();
    still->context = gp_context_new();
    gp_context_set_error_func(still->context, on_library_error, still);
    gp_abilities_list_new(&still->abilities);
    gp_abilities_list_load(still->abilities, still->context);
    return still;
}

Still *still_open(const struct still_options *options, GError **error) {
    g_autoptr(Still) still = still_new(options);
    g_autoptr(GArray) found = look_again(still, 0, error);
    if (!found || !check_battery(still, error) || !check_card(still, error) ||
        !apply(still, error) || !list_exposures(still, error))
        return NULL;
    if (found->len > 0)
        g_printerr("mesorig-gphoto2: %u pictures are on the card already; they stay there\n",
                   found->len);
    still->model = read_model(still);
    still->serial = read_serial(still);
    return g_steal_pointer(&still);
}

void still_close(Still *still) {
    if (!still)
        return;
    disconnect(still);
    gp_abilities_list_free(still->abilities);
    gp_context_unref(still->context);
    g_array_unref(still->exposures);
    g_array_unref(still->exposures_us);
    g_hash_table_unref(still->known);
    g_free(still->model);
    g_free(still->serial);
    g_free(still->said);
    g_free(still->stem);
    g_free(still);
}

const char *still_model(const Still *still) {
    return still->model;
}

const char *still_serial(const Still *still) {
    return still->serial;
}

const GArray *still_exposures(const Still *still) {
    return still->exposures_us;
}

static gboolean pause_shot(const struct still_shot *shot, GError **error) {
    if (shot->wait.pause(PAUSE_MS, shot->wait.data))
        return TRUE;
    g_set_error(error, G_IO_ERROR, G_IO_ERROR_CANCELLED, "the picture was given up");
    return FALSE;
}

/* Returns the time in µs by which a loop that looks for events may run longer. This is the time in
 * which this program could not run, for example on a busy computer. The loop may run longer because
 * a virtual camera or the network was often held up for the same time. *pass_us is the time of the
 * last call, and is set to the present time. */
static gint64 forgive(gint64 *pass_us) {
    const gint64 took_us = now_us() - *pass_us;
    *pass_us += took_us;
    return MAX(took_us - MAX_PASS_US, 0);
}

/* Returns whether the camera still answers. */
static gboolean answers(Still *still) {
    CameraStorageInformation *stores = NULL;
    int n = 0;
    const int code = gp_camera_get_storageinfo(still->camera, &stores, &n, still->context);
    free(stores);
    return code >= GP_OK || code == GP_ERROR_NOT_SUPPORTED;
}

/* Connects the camera again if it does not answer. Then waits for the picture of a shot that was
 * given up, and removes that picture. If the camera does not announce the picture, looks for it on
 * the card.
 *
 * Returns FALSE with an error if the deadline of the present shot has come, if the present shot is
 * given up, if the camera cannot be connected, or if its card cannot be read. */
static gboolean settle(Still *still, const struct still_shot *shot, GError **error) {
    CameraFilePath path;
    if (still->camera && !answers(still))
        disconnect(still);
    for (gint64 pass_us = now_us();
         still->abandoned && now_us() < still->abandoned_until_us && still->camera;
         still->abandoned_until_us += forgive(&pass_us)) {
        switch (next_event(still, &path)) {
        case PICTURE:
            remove_file(still, &path);
            still->abandoned = FALSE;
            break;
        case LOST:
            disconnect(still);
            break;
        case NOTHING:
            if (!pause_shot(shot, error))
                return FALSE;
            break;
        default:
            break;
        }
        if (now_us() >= shot->deadline_us)
            return fail(error, "the camera still takes an earlier picture that was given up; wait, "
                               "then try again");
    }
    while (!still->camera || still->abandoned) {
        g_autoptr(GArray) found = look_again(still, still->abandoned_us, error);
        if (!found)
            return FALSE;
        if (!still->abandoned)
            break;
        for (guint i = 0; i < found->len; i++)
            remove_file(still, &g_array_index(found, CameraFilePath, i));
        if (found->len > 0 || now_us() >= still->abandoned_until_us)
            still->abandoned = FALSE;
        else if (!pause_shot(shot, error))
            return FALSE;
        if (now_us() >= shot->deadline_us)
            return fail(error, "the camera still takes an earlier picture that was given up; wait, "
                               "then try again");
    }
    return TRUE;
}

static const struct exposure *find_exposure(const Still *still, gint64 us) {
    const struct exposure *nearest = NULL;
    for (guint i = 0; i < still->exposures->len; i++) {
        const struct exposure *exposure = &g_array_index(still->exposures, struct exposure, i);
        if (!nearest || ABS(exposure->us - us) < ABS(nearest->us - us))
            nearest = exposure;
    }
    return nearest;
}

/* Sets the exposure, and the options again, because somebody may have turned a dial of the camera.
 * A value that the camera has already is only read. */
static gboolean set_all(Still *still, gint64 us, GError **error) {
    return apply(still, error) && set(still, still->shutter, find_exposure(still, us)->text, error);
}

/* Sets the error of a trigger or picture that has failed: that the card is full, that the battery
 * is empty, or otherwise the text `what`. Always returns FALSE. */
static gboolean fail_shot(Still *still, const char *what, GError **error) {
    still->battery_us = 0;
    if (still->camera && (!check_card(still, error) || !check_battery(still, error)))
        return FALSE;
    return fail(error, "%s", what);
}

/* Opens the shutter. A camera that is busy refuses the trigger, which is then given again.
 * *ret_begin_us is a time just before the exposure. If the camera has not answered, sets *ret_lost
 * and returns TRUE, because the camera may have obeyed. */
static gboolean trigger(Still *still, const struct still_shot *shot, gint64 latest_us,
                        gint64 *ret_begin_us, gboolean *ret_lost, GError **error) {
    CameraFilePath path;
    for (;;) {
        begin_call(still);
        *ret_begin_us = now_us();
        const int code = gp_camera_trigger_capture(still->camera, still->context);
        if (code >= GP_OK)
            return TRUE;
        if (code == GP_ERROR_CAMERA_BUSY && now_us() < latest_us) {
            while (next_event(still, &path) == PICTURE)
                ; /* it was taken by hand */
            if (!pause_shot(shot, error))
                return FALSE;
            continue;
        }
        if (code == GP_ERROR_CAMERA_BUSY)
            return fail_shot(still, "the camera stays busy; look at its display", error);
        g_autofree char *what = g_strdup_printf(
            "the camera refuses to take a picture: %s; see that it is set to manual "
            "focus and manual exposure",
            reason(still, code));
        *ret_lost = !answers(still);
        return *ret_lost || fail_shot(still, what, error);
    }
}

/* Looks for the picture on the card. Returns FALSE without an error if it is not there. If the
 * first picture is a JPEG and a raw file, the raw file is taken. */
static gboolean look_for_picture(Still *still, gint64 begin_us, CameraFilePath *ret,
                                 GError **error) {
    g_autoptr(GArray) found = look_again(still, begin_us, error);
    if (!found || found->len == 0)
        return FALSE;
    *ret = g_array_index(found, CameraFilePath, 0);
    g_autofree char *stem = stem_of(ret->name);
    for (guint i = 1; still->is_first && i < found->len; i++) {
        CameraFilePath other = g_array_index(found, CameraFilePath, i);
        g_autofree char *other_stem = stem_of(other.name);
        if (!g_str_equal(stem, other_stem))
            return fail(error,
                        "%u new pictures are on the card, and only one is of this shot; take no "
                        "pictures by hand during a capture",
                        found->len);
        if (raw_is(other.name)) {
            const CameraFilePath jpeg = *ret;
            *ret = other;
            other = jpeg;
        }
        remove_file(still, &other);
    }
    return TRUE;
}

/* Waits for the picture of a trigger at begin_us. */
static gboolean await_picture(Still *still, const struct still_shot *shot, gint64 begin_us,
                              gboolean lost, CameraFilePath *ret, GError **error) {
    const gint64 end_us = begin_us + shot->exposure_us, last_us = shot->deadline_us - LOOK_US;
    gint64 look_us = end_us + 2 * shot->exposure_us +
                     (still->options->trigger_ms + still->options->readout_ms) * (gint64)1000;
    gint64 pass_us = begin_us;
    gboolean has_jpeg = FALSE, told = FALSE;
    CameraFilePath path = {0};
    for (;;) {
        const enum happening happening = lost ? LOST : next_event(still, &path);
        const gboolean can_be = now_us() >= end_us;
        if ((happening == PICTURE || happening == COMPLETE) && can_be && !told) {
            shot->wait.exposed(shot->wait.data);
            told = TRUE;
        }
        if (happening == PICTURE && can_be) {
            if (has_jpeg)
                remove_file(still, ret);
            *ret = path;
            if (!still->is_first || raw_is(path.name))
                return TRUE;
            /* The first picture is a JPEG. Perhaps a raw file follows. */
            has_jpeg = TRUE;
            look_us = now_us() + MAX(now_us() - begin_us, COMPANION_US);
        }
        if (happening == FULL)
            return fail_shot(
                still,
                "the camera reports that its card is full; copy the pictures and format the card",
                error);
        if (happening == LOST) {
            lost = FALSE;
            if (look_for_picture(still, begin_us, ret, error) && can_be)
                return TRUE;
            if (error && *error)
                return FALSE;
        }
        look_us += forgive(&pass_us);
        if (now_us() >= MIN(look_us, last_us))
            break;
        if (happening == NOTHING && !pause_shot(shot, error))
            return FALSE;
    }
    if (has_jpeg || look_for_picture(still, begin_us, ret, error))
        return TRUE;
    if (error && *error)
        return FALSE;
    still->abandoned = FALSE;
    return fail_shot(still, "the camera has taken no picture; see that it is set to manual focus",
                     error);
}

/* Copies a file to this computer. If the connection fails, tries once more with a new one. */
static gboolean copy(Still *still, const CameraFilePath *from, const char *to, GError **error) {
    for (int i = 0;; i++) {
        File *file = NULL;
        const int fd = open(to, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC | O_NOFOLLOW, 0600);
        if (fd < 0)
            return fail(error,
                        "the file %s cannot be written: %s; check the free space and the rights of "
                        "its folder",
                        to, g_strerror(errno));
        gp_file_new_from_fd(&file, fd);
        begin_call(still);
        const int code = gp_camera_file_get(still->camera, from->folder, from->name,
                                            GP_FILE_TYPE_NORMAL, file, still->context);
        gp_file_unref(file); /* closes the file */
        if (code >= GP_OK)
            return TRUE;
        g_autofree char *what = g_strdup(reason(still, code));
        if (i > 0)
            return fail(error, "%s/%s cannot be copied from the camera: %s; check the cable",
                        from->folder, from->name, what);
        g_printerr("mesorig-gphoto2: %s/%s: %s; trying again\n", from->folder, from->name, what);
        g_autoptr(GArray) unused = look_again(still, 0, error);
        if (!unused)
            return FALSE;
    }
}

/* Takes the events that wait. Removes from the card what belongs to the last picture, such as a
 * JPEG that came after it, and the picture of a shot that was given up. */
static void clear_events(Still *still) {
    CameraFilePath path;
    enum happening happening = OTHER;
    for (int i = 0; i < MAX_IDLE && happening != NOTHING && happening != LOST; i++) {
        happening = next_event(still, &path);
        g_autofree char *stem = happening == PICTURE ? stem_of(path.name) : NULL;
        if (still->abandoned && stem) {
            remove_file(still, &path);
            still->abandoned = FALSE;
        } else if (stem && g_strcmp0(stem, still->stem) == 0) {
            remove_file(still, &path);
        }
    }
}

void still_idle(Still *still) {
    if (still->camera)
        clear_events(still);
}

/* Takes the camera's clock from its first picture. */
static void set_clock(Still *still, const CameraFilePath *path, gint64 taken_us) {
    const gint64 us = still->is_first ? date_us(still, path) : 0;
    if (us <= 0)
        return;
    still->clock_us = us - taken_us;
    still->has_clock = TRUE;
}

char *still_shoot(Still *still, const struct still_shot *shot, GError **error) {
    const int trigger_us = still->options->trigger_ms * 1000;
    CameraFilePath path;
    gboolean lost = FALSE;
    gint64 begin_us;
    if (!settle(still, shot, error))
        return NULL;
    clear_events(still);
    if (!check_battery(still, error) || !set_all(still, shot->exposure_us, error))
        return NULL;
    if (!trigger(still, shot, shot->deadline_us - LOOK_US - shot->exposure_us - trigger_us,
                 &begin_us, &lost, error))
        return NULL;
    still->abandoned = TRUE;
    still->abandoned_us = begin_us;
    still->abandoned_until_us =
        begin_us + trigger_us + 3 * shot->exposure_us + still->options->readout_ms * (gint64)1000;
    if (!await_picture(still, shot, begin_us, lost, &path, error))
        return NULL;
    still->abandoned = FALSE;
    set_clock(still, &path, begin_us + shot->exposure_us);
    const char *dot = strrchr(path.name, '.');
    g_autofree char *name = g_strconcat("picture", dot ? dot : "", NULL);
    g_autofree char *to = g_build_filename(shot->folder, name, NULL);
    if (!copy(still, &path, to, error))
        return NULL;
    remove_file(still, &path);
    still->raw = raw_is(path.name);
    still->is_first = FALSE;
    g_free(still->stem);
    still->stem = stem_of(path.name);
    return g_steal_pointer(&to);
}

gboolean still_list(GError **error) {
    const struct still_options options = {.port = "usb"};
    g_autoptr(Still) still = still_new(&options);
    g_autoptr(Ports) ports = NULL;
    gp_port_info_list_new(&ports);
    const int code = gp_port_info_list_load(ports);
    if (code < GP_OK)
        return fail(error,
                    "libgphoto2 cannot search the ports: %s; check that the package "
                    "libgphoto2-port12 is installed",
                    gp_result_as_string(code));
    g_autoptr(Names) found = detect(still, ports);
    for (int i = 0; i < gp_list_count(found); i++) {
        const char *port = found_port(found, i);
        g_autofree char *place = place_of_port(port);
        g_autofree char *serial = read_attribute(place, "serial");
        if (g_str_has_prefix(port, "usb:"))
            g_print("%s\t%s\t%s\t%s\n", place, found_model(found, i), serial ? serial : "", port);
    }
    return TRUE;
}
