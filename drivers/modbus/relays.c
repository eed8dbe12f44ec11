#include "bus.h"
#include "devices.h"

/* Less than the class waits, so that the line's own words are heard. */
#define DEADLINE_MS 1500

struct modbus_lamps {
    struct modbus_link link;
    int first_coil, n;
    double warm_up_s;
    ModbusBus *bus;
    GQueue pending; /* of struct pending, in order */
};

struct pending {
    int index;
    gboolean on;
};

#define LAMPS(name) G_STRUCT_OFFSET(struct modbus_lamps, name)

static const struct option lamps_options[] = {
    MODBUS_LINK_OPTIONS,
    {"first_coil", OPTION_INT, NULL, 0, 65535, "0", NULL, LAMPS(first_coil),
     "Coil of the bank's first lamp, counted from 0; the others follow"},
    {"n", OPTION_INT, NULL, 1, MODBUS_MAX_VALUES, NULL, NULL, LAMPS(n), "How many lamps it has"},
    {"warm_up_s", OPTION_DOUBLE, "s", 0, 36000, "0", NULL, LAMPS(warm_up_s),
     "From switching on until the output is stable"},
    {NULL},
};

static void on_switched(const struct modbus_job *job, const GError *error, gpointer data) {
    LampBank *bank = data;
    struct modbus_lamps *lamps = bank->device.priv;
    g_autofree struct pending *done = g_queue_pop_head(&lamps->pending);
    GError *failed = error ? g_error_copy(error) : NULL;
    g_prefix_error(&failed, "lamps %s: ", bank->device.name);
    lamps_report(bank, done->index, done->on, failed);
}

static void write_coils(const struct modbus_lamps *lamps, struct modbus_job *job, int index,
                        gboolean on) {
    struct modbus_request *request = modbus_job_add(
        job, MODBUS_WRITE_COILS, lamps->first_coil + MAX(index, 0), index < 0 ? lamps->n : 1);
    for (int i = 0; i < request->n; i++)
        request->values[i] = on != FALSE;
    request->verify = TRUE;
}

static gboolean set_lamp(LampBank *bank, int index, gboolean on, GError **error) {
    struct modbus_lamps *lamps = bank->device.priv;
    struct modbus_job job = {0};
    write_coils(lamps, &job, index, on);
    struct pending *pending = g_new0(struct pending, 1);
    pending->index = index;
    pending->on = on;
    g_queue_push_tail(&lamps->pending, pending);
    modbus_bus_start(lamps->bus, &lamps->link, &job, FALSE, DEADLINE_MS, on_switched, bank);
    return TRUE;
}

static gboolean all_off(struct modbus_lamps *lamps, GError **error) {
    struct modbus_job job = {0};
    write_coils(lamps, &job, -1, FALSE);
    return modbus_bus_do(lamps->bus, &lamps->link, &job, DEADLINE_MS, error);
}

static gboolean open_lamps(LampBank *bank, GError **error) {
    struct modbus_lamps *lamps = bank->device.priv;
    lamps->bus = modbus_bus_get(&lamps->link, &bank->device, error);
    if (!lamps->bus)
        return FALSE;
    bank->n = lamps->n;
    bank->warm_up_s = lamps->warm_up_s;
    if (all_off(lamps, error))
        return TRUE;
    g_prefix_error(error, "lamps %s: ", bank->device.name);
    g_clear_pointer(&lamps->bus, modbus_bus_unref);
    return FALSE;
}

static void close_lamps(LampBank *bank) {
    struct modbus_lamps *lamps = bank->device.priv;
    modbus_bus_cancel(lamps->bus, bank);
    g_queue_clear_full(&lamps->pending, g_free);
    all_off(lamps, NULL);
    g_clear_pointer(&lamps->bus, modbus_bus_unref);
}

const struct lamps_driver modbus_relays_driver = {
    .info = {"lamps", "modbus-relays", "Lamps on the coils of a Modbus relay board", lamps_options,
             sizeof(struct modbus_lamps)},
    .open = open_lamps,
    .close = close_lamps,
    .set = set_lamp,
};

struct modbus_laser {
    struct modbus_link link;
    int coil;
    double warm_up_s;
    ModbusBus *bus;
};

#define LASER(name) G_STRUCT_OFFSET(struct modbus_laser, name)

static const struct option laser_options[] = {
    MODBUS_LINK_OPTIONS,
    {"coil", OPTION_INT, NULL, 0, 65535, "0", NULL, LASER(coil),
     "Coil that switches it, counted from 0"},
    {"warm_up_s", OPTION_DOUBLE, "s", 0, 36000, "0", NULL, LASER(warm_up_s),
     "From switching on until the output is stable"},
    {NULL},
};

static void write_coil(const struct modbus_laser *laser, struct modbus_job *job, gboolean on) {
    struct modbus_request *request = modbus_job_add(job, MODBUS_WRITE_COILS, laser->coil, 1);
    request->values[0] = on != FALSE;
    request->verify = TRUE;
}

static void on_laser_off(const struct modbus_job *job, const GError *error, gpointer data) {
}

static void on_laser(const struct modbus_job *job, const GError *error, gpointer data) {
    Laser *laser = data;
    struct modbus_laser *priv = laser->device.priv;
    gboolean on = job->requests[0].values[0] != 0;
    GError *failed = error ? g_error_copy(error) : NULL;
    if (failed && on) { /* it may have come through: nothing shines that is not known of */
        struct modbus_job off = {0};
        write_coil(priv, &off, FALSE);
        modbus_bus_start(priv->bus, &priv->link, &off, FALSE, DEADLINE_MS, on_laser_off, laser);
    }
    g_prefix_error(&failed, "laser %s: ", laser->device.name);
    laser_report(laser, on, failed);
}

static gboolean set_laser(Laser *laser, gboolean on, GError **error) {
    struct modbus_laser *priv = laser->device.priv;
    struct modbus_job job = {0};
    write_coil(priv, &job, on);
    modbus_bus_start(priv->bus, &priv->link, &job, FALSE, DEADLINE_MS, on_laser, laser);
    return TRUE;
}

static gboolean laser_off(struct modbus_laser *priv, GError **error) {
    struct modbus_job job = {0};
    write_coil(priv, &job, FALSE);
    return modbus_bus_do(priv->bus, &priv->link, &job, DEADLINE_MS, error);
}

static gboolean open_laser(Laser *laser, GError **error) {
    struct modbus_laser *priv = laser->device.priv;
    priv->bus = modbus_bus_get(&priv->link, &laser->device, error);
    if (!priv->bus)
        return FALSE;
    laser->warm_up_s = priv->warm_up_s;
    if (laser_off(priv, error))
        return TRUE;
    g_prefix_error(error, "laser %s: ", laser->device.name);
    g_clear_pointer(&priv->bus, modbus_bus_unref);
    return FALSE;
}

static void close_laser(Laser *laser) {
    struct modbus_laser *priv = laser->device.priv;
    modbus_bus_cancel(priv->bus, laser);
    laser_off(priv, NULL);
    g_clear_pointer(&priv->bus, modbus_bus_unref);
}

const struct laser_driver modbus_laser_driver = {
    .info = {"laser", "modbus-laser", "A laser on a coil of a Modbus relay board", laser_options,
             sizeof(struct modbus_laser)},
    .open = open_laser,
    .close = close_laser,
    .set = set_laser,
};
