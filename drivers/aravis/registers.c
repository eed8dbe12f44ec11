#include "registers.h"

#include "drivers/recording.h"

#include <string.h>

#define NAME_KEY "mesorig-name"

#define MAX_READ 512 /* bytes; the description of a camera is longer, and is not recorded */

/* Returns whether a register of GigE Vision holds a network address: the camera's MAC address (two
 * registers), its present IP address and gateway, its stored IP address and gateway, and the
 * addresses of the controlling program, of the receiver of messages and of the receiver of
 * frames. */
static gboolean is_address(guint64 at) {
    static const guint64 places[] = {0x0008, 0x000c, 0x0024, 0x0044, 0x064c,
                                     0x066c, 0x0a14, 0x0b10, 0x0d18};
    for (gsize i = 0; i < G_N_ELEMENTS(places); i++)
        if (at == places[i])
            return TRUE;
    return FALSE;
}

/* Aravis has a class for GigE Vision and one for USB3 Vision. All features, and the driver, read
 * and write registers through the functions of these classes. */
struct functions {
    ArvDeviceClass *of; /* NULL: not used yet */
    gboolean (*read_memory)(ArvDevice *, guint64, guint32, void *, GError **);
    gboolean (*write_memory)(ArvDevice *, guint64, guint32, void *, GError **);
    gboolean (*read_register)(ArvDevice *, guint64, guint32 *, GError **);
    gboolean (*write_register)(ArvDevice *, guint64, guint32, GError **);
};

static struct functions known[2];
static GMutex mutex;

static const struct functions *functions_of(ArvDevice *device) {
    const ArvDeviceClass *of = ARV_DEVICE_GET_CLASS(device);
    return known[0].of == of ? &known[0] : &known[1];
}

static struct recording_bus bus_of(ArvDevice *device) {
    const char *name = g_object_get_data(G_OBJECT(device), NAME_KEY);
    return (struct recording_bus){"genicam", name ? name : "camera"};
}

/* Records "read ADDRESS SIZE" or "write ADDRESS SIZE", and the bytes. */
static void record(ArvDevice *device, gboolean writes, guint64 at, guint32 n, const guint8 *bytes,
                   gboolean done, GError **error) {
    const struct recording_bus bus = bus_of(device);
    if (!recording_is_on())
        return;
    g_autofree char *what =
        g_strdup_printf("%s 0x%" G_GINT64_MODIFIER "x %u\n", writes ? "write" : "read", at, n);
    recording_text(bus, RECORDING_SENT, what, strlen(what));
    if (!done)
        recording_note(bus, "failed: %s",
                       error && *error ? (*error)->message : "no reason is given");
    else if (is_address(at) || n > MAX_READ)
        recording_note(bus, "%u bytes, not recorded", n);
    else
        recording_bytes(bus, writes ? RECORDING_SENT : RECORDING_RECEIVED, bytes, n);
}

static gboolean read_memory(ArvDevice *device, guint64 at, guint32 n, void *ret, GError **error) {
    const gboolean done = functions_of(device)->read_memory(device, at, n, ret, error);
    record(device, FALSE, at, n, ret, done, error);
    return done;
}

static gboolean write_memory(ArvDevice *device, guint64 at, guint32 n, void *data, GError **error) {
    const gboolean done = functions_of(device)->write_memory(device, at, n, data, error);
    record(device, TRUE, at, n, data, done, error);
    return done;
}

static gboolean read_register(ArvDevice *device, guint64 at, guint32 *ret, GError **error) {
    const gboolean done = functions_of(device)->read_register(device, at, ret, error);
    const guint32 value = GUINT32_TO_BE(done ? *ret : 0);
    record(device, FALSE, at, sizeof value, (const guint8 *)&value, done, error);
    return done;
}

static gboolean write_register(ArvDevice *device, guint64 at, guint32 value, GError **error) {
    const gboolean done = functions_of(device)->write_register(device, at, value, error);
    const guint32 wire = GUINT32_TO_BE(value);
    record(device, TRUE, at, sizeof wire, (const guint8 *)&wire, done, error);
    return done;
}

/* Puts the functions of this module in front of those of a class, once. */
static void wrap(ArvDeviceClass *class) {
    struct functions *functions = known[0].of && known[0].of != class ? &known[1] : &known[0];
    if (functions->of)
        return;
    *functions = (struct functions){class, class->read_memory, class->write_memory,
                                    class->read_register, class->write_register};
    class->read_memory = read_memory;
    class->write_memory = write_memory;
    class->read_register = read_register;
    class->write_register = write_register;
}

void aravis_registers_record(ArvDevice *device, const char *name) {
    if (!recording_is_on())
        return;
    g_object_set_data_full(G_OBJECT(device), NAME_KEY, g_strdup(name), g_free);
    g_mutex_lock(&mutex);
    wrap(ARV_DEVICE_GET_CLASS(device));
    g_mutex_unlock(&mutex);
}
