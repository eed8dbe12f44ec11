#include "web_rig.h"

#include "base/json.h"
#include "base/png_bytes.h"
#include "bus/bus.h"
#include "bus/bus_client.h"
#include "rig1-bus.h"

#include <string.h>

#define STATE_INTERVAL_MS 500
#define CALL_TIMEOUT_MS   60000
/* seconds between two attempts to connect to a daemon that does not answer */
#define AGAIN_S 2
/* maximum number of samples of the progress; if there are more, every second one is removed */
#define MAX_SAMPLES 2000
#define STEPS       64  /* bins of a histogram */
#define WHITE       250 /* from this sRGB value on, a pixel counts as white */
#define BLACK       5   /* up to this sRGB value, a pixel counts as black */
#define COLOURS     3

struct waiting { /* a request that waits for a picture */
    WebRigPicture back;
    gpointer data;
};

struct camera {
    struct web_picture picture; /* png is NULL if the latest picture has not been fetched */
    GArray *waiting;            /* of struct waiting; NULL if no call is under way */
    /* the camera has a newer picture than the one that the call fetches */
    gboolean stale;
};

struct sample {
    double elapsed_s;
    int shots;
};

struct WebRig {
    BusRig1 *rig; /* NULL if no daemon answers at address */
    GDBusConnection *connection;
    char *address; /* address of the daemon's own socket; NULL if the daemon is on a bus */
    /* reason why no daemon answers at address; NULL if a daemon answers or no connection was tried
     * yet */
    char *away;
    gboolean connecting; /* a connection to address is being made */
    guint again_id;
    WebRigNews news;
    gpointer news_data;
    GVariant *told_places; /* places in the last "state" that had them; NULL if there were none */
    guint state_id;
    GQueue events; /* of char *, JSON, the oldest first */
    GArray *samples;
    GHashTable *cameras; /* name → struct camera */
    GCancellable *cancellable;
};

static void clear_picture(struct web_picture *picture) {
    g_clear_pointer(&picture->png, g_bytes_unref);
    g_clear_pointer(&picture->json, g_free);
}

static void camera_free(gpointer data) {
    struct camera *camera = data;
    clear_picture(&camera->picture);
    if (camera->waiting)
        g_array_unref(camera->waiting);
    g_free(camera);
}

static gboolean is_away(const WebRig *rig) {
    g_autofree char *owner =
        rig->address ? NULL : g_dbus_proxy_get_name_owner(G_DBUS_PROXY(rig->rig));
    return rig->address ? !rig->rig : !owner;
}

static void add_text(GVariantBuilder *to, const char *key, const char *value) {
    g_autofree char *valid = g_utf8_make_valid(value ? value : "", -1);
    g_variant_builder_add(to, "{sv}", key, g_variant_new_string(valid));
}

static void add_number(GVariantBuilder *to, const char *key, double value) {
    g_variant_builder_add(to, "{sv}", key, g_variant_new_double(value));
}

/* Adds whether the rig is held in the safe state, and which devices have not confirmed that they
 * are safe. */
static void add_safety(GVariantBuilder *to, BusRig1 *bus) {
    g_autoptr(GVariant) latched = g_dbus_proxy_get_cached_property(G_DBUS_PROXY(bus), "Latched");
    g_autoptr(GVariant) unsafe = g_dbus_proxy_get_cached_property(G_DBUS_PROXY(bus), "Unsafe");
    /* A daemon of an earlier version does not have these properties. */
    g_variant_builder_add(to, "{sv}", "latched", latched ? latched : g_variant_new_boolean(FALSE));
    g_variant_builder_add(to, "{sv}", "unsafe", unsafe ? unsafe : g_variant_new_strv(NULL, 0));
}

/* Adds the pose and the light of the last shot. */
static void add_pose(GVariantBuilder *to, BusRig1 *bus) {
    GVariant *pose = bus_rig1_get_pose(bus);
    const char *class_name, *name;
    double turntable_deg, arc_deg;
    if (!pose) /* a daemon of an earlier version does not have this property */
        return;
    g_variant_get(pose, "(dd&s&s)", &turntable_deg, &arc_deg, &class_name, &name);
    add_number(to, "turntable_deg", turntable_deg);
    add_number(to, "arc_deg", arc_deg);
    add_text(to, "light_class", class_name);
    add_text(to, "light", name);
}

/* Adds the places of cameras, lamps and lasers. */
static void add_places(GVariantBuilder *to, GVariant *list) {
    GVariantBuilder places;
    const char *class_name, *name;
    double theta_deg, phi_deg;
    gboolean carried;
    if (!list) /* a daemon of an earlier version does not have this property */
        return;
    g_variant_builder_init(&places, G_VARIANT_TYPE("aa{sv}"));
    GVariantIter iter;
    g_variant_iter_init(&iter, list);
    while (g_variant_iter_next(&iter, "(&s&sddb)", &class_name, &name, &theta_deg, &phi_deg,
                               &carried)) {
        GVariantBuilder place;
        g_variant_builder_init(&place, G_VARIANT_TYPE_VARDICT);
        add_text(&place, "class", class_name);
        add_text(&place, "name", name);
        add_number(&place, "theta_deg", theta_deg);
        add_number(&place, "phi_deg", phi_deg);
        g_variant_builder_add(&place, "{sv}", "carried", g_variant_new_boolean(carried));
        g_variant_builder_add_value(&places, g_variant_builder_end(&place));
    }
    g_variant_builder_add(to, "{sv}", "places", g_variant_builder_end(&places));
}

static char *state_text(const WebRig *rig, gboolean with_places) {
    BusRig1 *bus = rig->rig;
    GVariantBuilder to, devices;
    const gboolean away = is_away(rig);
    g_variant_builder_init(&to, G_VARIANT_TYPE_VARDICT);
    add_text(&to, "state", away ? "away" : bus_rig1_get_state(bus));
    add_text(&to, "version", MESORIG_VERSION);
    if (away && rig->away)
        add_text(&to, "reason", rig->away);
    if (!away) {
        const int shots = bus_rig1_get_shots(bus), done = bus_rig1_get_shots_done(bus);
        add_text(&to, "reason", bus_rig1_get_reason(bus));
        add_text(&to, "prompt", bus_rig1_get_prompt(bus));
        add_text(&to, "doing", bus_rig1_get_doing(bus));
        add_text(&to, "rig", bus_rig1_get_rig_path(bus));
        add_text(&to, "session", bus_rig1_get_session(bus));
        g_variant_builder_add(&to, "{sv}", "simulated",
                              g_variant_new_boolean(bus_rig1_get_simulated(bus)));
        g_variant_builder_add(&to, "{sv}", "shots", g_variant_new_int32(shots));
        g_variant_builder_add(&to, "{sv}", "shots_done", g_variant_new_int32(done));
        g_variant_builder_add(&to, "{sv}", "frames", g_variant_new_int64(bus_rig1_get_frames(bus)));
        g_variant_builder_add(&to, "{sv}", "retakes",
                              g_variant_new_int64(bus_rig1_get_retakes(bus)));
        g_variant_builder_add(&to, "{sv}", "elapsed_s",
                              g_variant_new_double(bus_rig1_get_elapsed(bus)));
        g_variant_builder_add(&to, "{sv}", "left_s", g_variant_new_double(bus_rig1_get_left(bus)));
        g_variant_builder_add(&to, "{sv}", "predicted_end",
                              g_variant_new_uint64(bus_rig1_get_predicted_end(bus)));
        g_variant_builder_add(&to, "{sv}", "bytes_stored",
                              g_variant_new_uint64(bus_rig1_get_bytes_stored(bus)));
        g_variant_builder_add(&to, "{sv}", "bytes_expected",
                              g_variant_new_uint64(bus_rig1_get_bytes_expected(bus)));
        add_safety(&to, bus);
        add_pose(&to, bus);
        if (with_places)
            add_places(&to, bus_rig1_get_places(bus));
        g_variant_builder_init(&devices, G_VARIANT_TYPE("aa{sv}"));
        GVariant *list = bus_rig1_get_devices(bus);
        GVariantIter iter;
        const char *class_name, *name, *driver, *health;
        if (list) {
            g_variant_iter_init(&iter, list);
            while (g_variant_iter_next(&iter, "(&s&s&s&s)", &class_name, &name, &driver, &health)) {
                GVariantBuilder device;
                g_variant_builder_init(&device, G_VARIANT_TYPE_VARDICT);
                add_text(&device, "class", class_name);
                add_text(&device, "name", name);
                add_text(&device, "driver", driver);
                add_text(&device, "health", health);
                g_variant_builder_add_value(&devices, g_variant_builder_end(&device));
            }
        }
        g_variant_builder_add(&to, "{sv}", "devices", g_variant_builder_end(&devices));
        add_text(&to, "queue_state", bus_rig1_get_queue_state(bus));
        add_text(&to, "queue_reason", bus_rig1_get_queue_reason(bus));
        GVariant *queue = bus_rig1_get_queue(bus);
        g_variant_builder_add(&to, "{sv}", "queue", queue ? queue : g_variant_new("aa{sv}", NULL));
    }
    return json_text(g_variant_builder_end(&to));
}

char *web_rig_state(const WebRig *rig) {
    return state_text(rig, TRUE);
}

const char *web_rig_session(const WebRig *rig) {
    return is_away(rig) ? NULL : bus_rig1_get_session(rig->rig);
}

char *web_rig_events(const WebRig *rig) {
    GString *to = g_string_new("[");
    for (const GList *at = rig->events.head; at; at = at->next) {
        g_string_append(to, to->len > 1 ? ", " : "");
        g_string_append(to, at->data);
    }
    g_string_append_c(to, ']');
    return g_string_free(to, FALSE);
}

char *web_rig_progress(const WebRig *rig) {
    GVariantBuilder times, shots, to;
    g_variant_builder_init(&times, G_VARIANT_TYPE("ad"));
    g_variant_builder_init(&shots, G_VARIANT_TYPE("ai"));
    g_variant_builder_init(&to, G_VARIANT_TYPE_VARDICT);
    for (guint i = 0; i < rig->samples->len; i++) {
        const struct sample *sample = &g_array_index(rig->samples, struct sample, i);
        g_variant_builder_add(&times, "d", sample->elapsed_s);
        g_variant_builder_add(&shots, "i", sample->shots);
    }
    g_variant_builder_add(&to, "{sv}", "elapsed_s", g_variant_builder_end(&times));
    g_variant_builder_add(&to, "{sv}", "shots", g_variant_builder_end(&shots));
    return json_text(g_variant_builder_end(&to));
}

static void tell(const WebRig *rig, const char *name, const char *json) {
    if (rig->news)
        rig->news(name, json, rig->news_data);
}

/* Adds a sample to the progress if the number of shots done has changed. If that number or the
 * elapsed time has decreased, another session has begun, and the earlier samples are dropped. */
static void take_sample(WebRig *rig) {
    const struct sample now = {bus_rig1_get_elapsed(rig->rig), bus_rig1_get_shots_done(rig->rig)};
    const guint n = rig->samples->len;
    const struct sample *last = n ? &g_array_index(rig->samples, struct sample, n - 1) : NULL;
    if (last && (now.shots < last->shots || now.elapsed_s < last->elapsed_s))
        g_array_set_size(rig->samples, 0);
    else if (last && now.shots == last->shots)
        return;
    g_array_append_val(rig->samples, now);
    for (guint i = 1; rig->samples->len > MAX_SAMPLES && i < rig->samples->len; i++)
        g_array_remove_index(rig->samples, i);
}

static gboolean tell_state(gpointer data) {
    WebRig *rig = data;
    rig->state_id = 0;
    if (rig->rig)
        take_sample(rig);
    /* The places of a large rig take more bytes than the rest of the state, and they hardly ever
     * change. */
    GVariant *places = rig->rig ? bus_rig1_get_places(rig->rig) : NULL;
    const gboolean moved =
        places != rig->told_places &&
        !(places && rig->told_places && g_variant_equal(places, rig->told_places));
    if (moved) {
        g_clear_pointer(&rig->told_places, g_variant_unref);
        rig->told_places = places ? g_variant_ref(places) : NULL;
    }
    g_autofree char *json = state_text(rig, moved);
    tell(rig, "state", json);
    return G_SOURCE_REMOVE;
}

static void changed(WebRig *rig) {
    if (!rig->state_id)
        rig->state_id = g_timeout_add(STATE_INTERVAL_MS, tell_state, rig);
}

static void on_properties(GDBusProxy *proxy, GVariant *properties, GStrv invalidated,
                          gpointer data) {
    changed(data);
}

static void on_owner(GDBusProxy *proxy, GParamSpec *spec, gpointer data) {
    changed(data);
}

static void on_event(BusRig1 *bus, const char *level, const char *source, const char *message,
                     gpointer data) {
    WebRig *rig = data;
    GVariantBuilder to;
    g_variant_builder_init(&to, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(
        &to, "{sv}", "time",
        g_variant_new_int64(g_get_real_time() / G_USEC_PER_SEC)); /* s since 1970 */
    add_text(&to, "level", level);
    add_text(&to, "source", source);
    add_text(&to, "message", message);
    char *json = json_text(g_variant_builder_end(&to));
    g_queue_push_tail(&rig->events, json);
    if (rig->events.length > WEB_RIG_EVENTS)
        g_free(g_queue_pop_head(&rig->events));
    tell(rig, "event", json);
}

static void on_thumbnail(BusRig1 *bus, const char *name, gpointer data) {
    WebRig *rig = data;
    struct camera *camera = g_hash_table_lookup(rig->cameras, name);
    if (camera) {
        clear_picture(&camera->picture);
        camera->stale = TRUE;
    }
    g_autoptr(GString) json = g_string_new("{\"camera\": ");
    json_append_string(json, name);
    g_string_append_c(json, '}');
    tell(rig, "picture", json->str);
}

static void on_closed(GDBusConnection *connection, gboolean by_peer, GError *error, gpointer data);

/* Begins to listen to a daemon. Takes ownership of proxy. */
static void attach(WebRig *rig, BusRig1 *proxy) {
    rig->rig = proxy;
    rig->connection = g_object_ref(g_dbus_proxy_get_connection(G_DBUS_PROXY(proxy)));
    g_dbus_connection_set_exit_on_close(rig->connection, FALSE);
    g_dbus_proxy_set_default_timeout(G_DBUS_PROXY(proxy), CALL_TIMEOUT_MS);
    g_signal_connect(proxy, "g-properties-changed", G_CALLBACK(on_properties), rig);
    g_signal_connect(proxy, "notify::g-name-owner", G_CALLBACK(on_owner), rig);
    g_signal_connect(proxy, "event", G_CALLBACK(on_event), rig);
    g_signal_connect(proxy, "thumbnail-changed", G_CALLBACK(on_thumbnail), rig);
    if (rig->address)
        g_signal_connect(rig->connection, "closed", G_CALLBACK(on_closed), rig);
}

/* Stops listening to the daemon, and drops its pictures, because later pictures come from another
 * daemon. */
static void detach(WebRig *rig) {
    GHashTableIter iter;
    gpointer camera;
    if (!rig->rig)
        return;
    g_signal_handlers_disconnect_by_data(rig->rig, rig);
    g_signal_handlers_disconnect_by_data(rig->connection, rig);
    g_clear_object(&rig->rig);
    g_clear_object(&rig->connection);
    g_hash_table_iter_init(&iter, rig->cameras);
    while (g_hash_table_iter_next(&iter, NULL, &camera)) {
        clear_picture(&((struct camera *)camera)->picture);
        ((struct camera *)camera)->stale = TRUE;
    }
}

static gboolean connect_again(gpointer data);

/* Reports why the daemon cannot be reached, but not the same reason twice in a row. Tries again
 * after AGAIN_S. Takes ownership of why. */
static void stay_away(WebRig *rig, GError *why) {
    if (g_strcmp0(rig->away, why->message) != 0)
        g_printerr("mesorig-web: %s; mesorig-web tries again every %d s\n", why->message, AGAIN_S);
    g_free(rig->away);
    rig->away = g_strdup(why->message);
    g_error_free(why);
    rig->again_id = g_timeout_add_seconds(AGAIN_S, connect_again, rig);
    changed(rig);
}

static void on_proxy(GObject *source, GAsyncResult *result, gpointer data) {
    GError *error = NULL;
    BusRig1 *proxy = bus_rig1_proxy_new_finish(result, &error);
    WebRig *rig = data; /* no longer valid if the call was cancelled */
    if (g_error_matches(error, G_IO_ERROR, G_IO_ERROR_CANCELLED)) {
        g_error_free(error);
        return;
    }
    rig->connecting = FALSE;
    if (!proxy) {
        stay_away(rig, error);
        return;
    }
    if (rig->away)
        g_printerr("mesorig-web: mesorigd answers at %s\n", rig->address);
    g_clear_pointer(&rig->away, g_free);
    attach(rig, proxy);
    if (g_dbus_connection_is_closed(rig->connection))
        on_closed(rig->connection, TRUE, NULL, rig);
    changed(rig);
}

static void on_connected(GObject *source, GAsyncResult *result, gpointer data) {
    GError *error = NULL;
    WebRig *rig = data; /* no longer valid if the call was cancelled */
    g_autoptr(GDBusConnection) connection = bus_client_connect_finish(result, &error);
    if (connection) {
        bus_rig1_proxy_new(connection, G_DBUS_PROXY_FLAGS_NONE, NULL, BUS_PATH, rig->cancellable,
                           on_proxy, rig);
    } else if (g_error_matches(error, G_IO_ERROR, G_IO_ERROR_CANCELLED)) {
        g_error_free(error);
    } else {
        rig->connecting = FALSE;
        stay_away(rig, error);
    }
}

static gboolean connect_again(gpointer data) {
    WebRig *rig = data;
    rig->again_id = 0;
    rig->connecting = TRUE;
    bus_client_connect_async(rig->address, rig->cancellable, on_connected, rig);
    return G_SOURCE_REMOVE;
}

static void on_closed(GDBusConnection *connection, gboolean by_peer, GError *error, gpointer data) {
    WebRig *rig = data;
    detach(rig);
    stay_away(rig,
              g_error_new(G_IO_ERROR, G_IO_ERROR_CLOSED, "mesorigd at %s has ended", rig->address));
}

static WebRig *make(const char *address) {
    WebRig *rig = g_new0(WebRig, 1);
    rig->address = g_strdup(address);
    rig->cancellable = g_cancellable_new();
    rig->samples = g_array_new(FALSE, FALSE, sizeof(struct sample));
    rig->cameras = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, camera_free);
    return rig;
}

WebRig *web_rig_new(const char *address, const char *bus, GError **error) {
    const GBusType type = g_strcmp0(bus, "session") == 0 ? G_BUS_TYPE_SESSION : G_BUS_TYPE_SYSTEM;
    if (address) {
        WebRig *rig = make(address);
        connect_again(rig);
        while (rig->connecting)
            g_main_context_iteration(NULL, TRUE);
        return rig;
    }
    g_autoptr(GDBusConnection) connection = g_bus_get_sync(type, NULL, error);
    BusRig1 *proxy = connection
                         ? bus_rig1_proxy_new_sync(connection, G_DBUS_PROXY_FLAGS_DO_NOT_AUTO_START,
                                                   BUS_NAME, BUS_PATH, NULL, error)
                         : NULL;
    if (!proxy) {
        g_prefix_error(error,
                       "cannot connect to the %s bus (give --bus=system, --bus=session or "
                       "--address, as mesorigd was started): ",
                       bus ? bus : "system");
        return NULL;
    }
    WebRig *rig = make(NULL);
    attach(rig, proxy);
    return rig;
}

/* Answers the requests that wait for a picture of a camera with an error, because the WebRig is
 * freed. */
static void refuse_waiting(gpointer name, gpointer data, gpointer unused) {
    const struct camera *camera = data;
    g_autoptr(GError) error =
        g_error_new_literal(G_IO_ERROR, G_IO_ERROR_CANCELLED, "mesorig-web is ending");
    for (guint i = 0; camera->waiting && i < camera->waiting->len; i++) {
        const struct waiting *who = &g_array_index(camera->waiting, struct waiting, i);
        who->back(NULL, error, who->data);
    }
}

void web_rig_free(WebRig *rig) {
    if (!rig)
        return;
    g_cancellable_cancel(rig->cancellable);
    g_clear_handle_id(&rig->again_id, g_source_remove);
    while (g_main_context_iteration(NULL, FALSE)) /* lets cancelled calls end */
        ;
    g_clear_handle_id(&rig->again_id, g_source_remove);
    g_clear_handle_id(&rig->state_id, g_source_remove);
    detach(rig);
    g_hash_table_foreach(rig->cameras, refuse_waiting, NULL);
    g_queue_clear_full(&rig->events, g_free);
    g_array_unref(rig->samples);
    g_hash_table_unref(rig->cameras);
    g_object_unref(rig->cancellable);
    g_clear_pointer(&rig->told_places, g_variant_unref);
    g_free(rig->address);
    g_free(rig->away);
    g_free(rig);
}

void web_rig_listen(WebRig *rig, WebRigNews func, gpointer data) {
    rig->news = func;
    rig->news_data = data;
}

struct action {
    WebRigDone back;
    gpointer data;
};

static void on_called(GObject *proxy, GAsyncResult *result, gpointer data) {
    g_autofree struct action *action = data;
    g_autoptr(GError) error = NULL;
    g_autoptr(GVariant) answer = g_dbus_proxy_call_finish(G_DBUS_PROXY(proxy), result, &error);
    if (error)
        g_dbus_error_strip_remote_error(error);
    action->back(answer, error, action->data);
}

/* Returns the error for a call if there is no daemon at address, otherwise NULL. */
static GError *refuse_away(const WebRig *rig) {
    return rig->rig ? NULL
                    : g_error_new_literal(
                          G_IO_ERROR, G_IO_ERROR_NOT_CONNECTED,
                          rig->away ? rig->away
                                    : "no mesorigd has answered yet: try again in some seconds");
}

void web_rig_call(WebRig *rig, const char *method, WebRigDone back, gpointer data) {
    web_rig_call_with(rig, method, NULL, back, data);
}

void web_rig_call_with(WebRig *rig, const char *method, GVariant *parameters, WebRigDone back,
                       gpointer data) {
    g_autoptr(GError) away = refuse_away(rig);
    if (away) {
        if (parameters)
            g_variant_unref(g_variant_ref_sink(parameters));
        back(NULL, away, data);
        return;
    }
    struct action *action = g_new(struct action, 1);
    *action = (struct action){back, data};
    g_dbus_proxy_call(G_DBUS_PROXY(rig->rig), method, parameters, G_DBUS_CALL_FLAGS_NONE, -1,
                      rig->cancellable, on_called, action);
}

struct file_action {
    WebRigFiles back;
    gpointer data;
};

static void on_files(GObject *proxy, GAsyncResult *result, gpointer data) {
    g_autofree struct file_action *action = data;
    g_autoptr(GError) error = NULL;
    g_autoptr(GUnixFDList) files = NULL;
    g_autoptr(GVariant) answer =
        g_dbus_proxy_call_with_unix_fd_list_finish(G_DBUS_PROXY(proxy), &files, result, &error);
    if (error)
        g_dbus_error_strip_remote_error(error);
    action->back(answer, files, error, action->data);
}

void web_rig_call_files(WebRig *rig, const char *method, GVariant *parameters, WebRigFiles back,
                        gpointer data) {
    g_autoptr(GError) away = refuse_away(rig);
    if (away) {
        g_variant_unref(g_variant_ref_sink(parameters));
        back(NULL, NULL, away, data);
        return;
    }
    struct file_action *action = g_new(struct file_action, 1);
    *action = (struct file_action){back, data};
    g_dbus_proxy_call_with_unix_fd_list(G_DBUS_PROXY(rig->rig), method, parameters,
                                        G_DBUS_CALL_FLAGS_NONE, -1, NULL, rig->cancellable,
                                        on_files, action);
}

static void count(const guint8 *rgb, gsize n, const char *camera, double time_s, guint width,
                  guint height, struct web_picture *picture) {
    GVariantBuilder to, histogram;
    guint steps[COLOURS][STEPS] = {{0}};
    gsize white = 0, black = 0;
    for (gsize i = 0; i < n; i++) {
        const guint8 *pixel = rgb + COLOURS * i, most = MAX(MAX(pixel[0], pixel[1]), pixel[2]);
        white += most >= WHITE;
        black += most <= BLACK;
        for (int c = 0; c < COLOURS; c++)
            steps[c][pixel[c] * STEPS / 256]++;
    }
    g_variant_builder_init(&histogram, G_VARIANT_TYPE("aai"));
    for (int c = 0; c < COLOURS; c++) {
        g_variant_builder_open(&histogram, G_VARIANT_TYPE("ai"));
        for (int i = 0; i < STEPS; i++)
            g_variant_builder_add(&histogram, "i", (int)steps[c][i]);
        g_variant_builder_close(&histogram);
    }
    g_variant_builder_init(&to, G_VARIANT_TYPE_VARDICT);
    add_text(&to, "camera", camera);
    g_variant_builder_add(&to, "{sv}", "time_s", g_variant_new_double(time_s));
    g_variant_builder_add(&to, "{sv}", "width", g_variant_new_int32((int)width));
    g_variant_builder_add(&to, "{sv}", "height", g_variant_new_int32((int)height));
    g_variant_builder_add(&to, "{sv}", "white",
                          g_variant_new_double(n ? (double)white / (double)n : 0));
    g_variant_builder_add(&to, "{sv}", "black",
                          g_variant_new_double(n ? (double)black / (double)n : 0));
    g_variant_builder_add(&to, "{sv}", "histogram", g_variant_builder_end(&histogram));
    picture->json = json_text(g_variant_builder_end(&to));
}

static gboolean encode(GVariant *answer, const char *camera, struct web_picture *picture,
                       GError **error) {
    guint width, height;
    g_autoptr(GVariant) bytes = NULL;
    double time_s;
    gsize length;
    g_variant_get(answer, "(uu@ayd)", &width, &height, &bytes, &time_s);
    const guint8 *rgb = g_variant_get_fixed_array(bytes, &length, 1);
    if (length != (gsize)COLOURS * width * height || length == 0) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_DATA,
                    "mesorigd has sent a picture of camera %s that claims %u × %u pixels but has "
                    "%zu bytes: run mesorigd and mesorig-web of the same version",
                    camera, width, height, length);
        return FALSE;
    }
    if (!(picture->png = png_bytes(rgb, (int)width, (int)height, error))) {
        g_prefix_error(error, "cannot encode the picture of camera %s: ", camera);
        return FALSE;
    }
    count(rgb, (gsize)width * height, camera, time_s, width, height, picture);
    return TRUE;
}

struct fetch {
    WebRig *rig;
    char *camera;
};

static void on_picture(BusRig1 *proxy, GAsyncResult *result, gpointer data) {
    struct fetch *fetch = data;
    g_autoptr(GError) error = NULL;
    g_autoptr(GVariant) answer = g_dbus_proxy_call_finish(G_DBUS_PROXY(proxy), result, &error);
    /* The rig is no longer valid if the call was cancelled. */
    if (!g_error_matches(error, G_IO_ERROR, G_IO_ERROR_CANCELLED)) {
        struct camera *camera = g_hash_table_lookup(fetch->rig->cameras, fetch->camera);
        struct web_picture picture = {0};
        g_autoptr(GArray) waiting = g_steal_pointer(&camera->waiting);
        if (error)
            g_dbus_error_strip_remote_error(error);
        const gboolean ok = answer && encode(answer, fetch->camera, &picture, &error);
        for (guint i = 0; i < waiting->len; i++) {
            const struct waiting *who = &g_array_index(waiting, struct waiting, i);
            who->back(ok ? &picture : NULL, error, who->data);
        }
        if (ok && !camera->stale)
            camera->picture = picture;
        else
            clear_picture(&picture);
        if (!ok)
            g_hash_table_remove(fetch->rig->cameras, fetch->camera);
    }
    g_free(fetch->camera);
    g_free(fetch);
}

/* Returns whether the rig has a camera of that name. The daemon is not asked for other names, so
 * that requests cannot fill rig->cameras with arbitrary names. */
static gboolean has_camera(const WebRig *rig, const char *name) {
    GVariant *list = bus_rig1_get_devices(rig->rig);
    GVariantIter iter;
    const char *class_name, *device;
    if (!list)
        return FALSE;
    g_variant_iter_init(&iter, list);
    while (g_variant_iter_next(&iter, "(&s&s&s&s)", &class_name, &device, NULL, NULL))
        if (strcmp(class_name, "camera") == 0 && strcmp(device, name) == 0)
            return TRUE;
    return FALSE;
}

void web_rig_picture(WebRig *rig, const char *name, WebRigPicture back, gpointer data) {
    struct camera *camera = g_hash_table_lookup(rig->cameras, name);
    const struct waiting who = {back, data};
    if (camera && camera->picture.png) {
        back(&camera->picture, NULL, data);
        return;
    }
    g_autoptr(GError) away = refuse_away(rig);
    if (away) {
        back(NULL, away, data);
        return;
    }
    if (!has_camera(rig, name)) {
        g_autoptr(GError) unknown =
            g_error_new(G_IO_ERROR, G_IO_ERROR_NOT_FOUND,
                        "the rig has no camera “%s”: /api/v1/state lists the devices", name);
        back(NULL, unknown, data);
        return;
    }
    if (!camera) {
        camera = g_new0(struct camera, 1);
        g_hash_table_insert(rig->cameras, g_strdup(name), camera);
    }
    const gboolean first = !camera->waiting;
    if (first)
        camera->waiting = g_array_new(FALSE, FALSE, sizeof(struct waiting));
    g_array_append_val(camera->waiting, who);
    if (!first)
        return;
    struct fetch *fetch = g_new(struct fetch, 1);
    *fetch = (struct fetch){rig, g_strdup(name)};
    camera->stale = FALSE;
    g_dbus_proxy_call(G_DBUS_PROXY(rig->rig), "GetThumbnail", g_variant_new("(s)", name),
                      G_DBUS_CALL_FLAGS_NONE, -1, rig->cancellable, (GAsyncReadyCallback)on_picture,
                      fetch);
}
