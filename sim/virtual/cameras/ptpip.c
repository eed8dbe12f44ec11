#include "ptpip.h"

#include "dng.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <gio/gio.h>
#include <math.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include <jpeglib.h> /* after stdio.h */

/* Packets of PTP/IP: a length, a type and a payload, little-endian. */
enum {
    INIT_COMMAND = 1,
    INIT_COMMAND_ACK,
    INIT_EVENT,
    INIT_EVENT_ACK,
    INIT_FAIL,
    REQUEST,
    RESPONSE,
    EVENT,
    START_DATA,
    DATA,
    CANCEL,
    END_DATA,
};

/* PTP (ISO 15740): operations, responses, events, properties, formats. */
enum {
    GET_DEVICE_INFO = 0x1001,
    OPEN_SESSION,
    CLOSE_SESSION,
    GET_STORAGE_IDS,
    GET_STORAGE_INFO,
    GET_NUM_OBJECTS,
    GET_OBJECT_HANDLES,
    GET_OBJECT_INFO,
    GET_OBJECT,
    GET_THUMB,
    DELETE_OBJECT,
    INITIATE_CAPTURE = 0x100e,
    GET_PROPERTY_DESC = 0x1014,
    GET_PROPERTY,
    SET_PROPERTY,
    NIKON_CHANGE_MODE = 0x90c2,
    NIKON_GET_EVENT = 0x90c7,
    NIKON_DEVICE_READY = 0x90c8,
    NIKON_CAPTURE = 0x9207,

    RESPONSE_OK = 0x2001,
    NOT_SUPPORTED = 0x2005,
    BAD_HANDLE = 0x2009,
    BAD_PROPERTY = 0x200a,
    STORE_FULL = 0x200c,
    NO_THUMB = 0x2010,
    BUSY = 0x2019,

    OBJECT_ADDED = 0x4002,
    PROPERTY_CHANGED = 0x4006,
    STORE_FULL_EVENT = 0x400a,
    CAPTURE_COMPLETE = 0x400d,
    NIKON_ADDED_IN_MEMORY = 0xc101,

    BATTERY = 0x5001,
    APERTURE = 0x5007, /* hundredths */
    SHUTTER = 0x500d,  /* tenths of a millisecond */
    MODE = 0x500e,
    ISO = 0x500f,

    FORMAT_FOLDER = 0x3001,
    FORMAT_JPEG = 0x3801,
    /* a code of PTP 1.1; libgphoto2 does not copy files with an unknown code */
    FORMAT_DNG = 0x3811,
};

enum { TYPE_UINT8 = 2, TYPE_UINT16 = 4, TYPE_UINT32 = 6 };

#define STORE         0x10001u
#define FOLDER_HANDLE 0xd0000000u
#define MEMORY_HANDLE 0xffff0001u /* handle of the picture in the camera's memory */
#define FOLDER_NAME   "100MESOR"
#define MAX_PACKET    65536
/* largest size in bytes of the data that a program may send with an operation */
#define MAX_SENT   (256 * 1024)
#define SHUTTER_US 100 /* unit of SHUTTER */

static const guint32 shutters[] = {1,    2,    5,    10,   20,    40,    50,   60,
                                   80,   100,  160,  200,  250,   320,   500,  640,
                                   1000, 2500, 5000, 6400, 10000, 20000, 50000};
static const guint32 isos[] = {100, 200, 400, 800};
static const guint32 apertures[] = {280, 400, 560, 800, 1100, 1600};
static const guint32 modes[] = {1, 2};

struct property {
    guint16 code;
    int type;
    guint32 value;
    const guint32 *choices;
    gsize n;
};

struct object {
    guint32 handle;
    char *name;
    guint16 format;
    GBytes *data;
    char *date; /* as PTP writes it: "20260131T235959" */
};

struct event { /* for Nikon's dialect, which polls events */
    guint16 code;
    guint32 parameter;
};

struct VirtualPtpip {
    struct virtual_ptpip_options options;
    char *host, *serial, *port;
    int listener, wake[2];
    GThread *acceptor;

    GMutex mutex; /* guards the following members */
    GCond cond;
    gboolean quit, exposing;
    int n_threads; /* threads of connections and of shots */
    GArray *fds;   /* of int: open connections */
    int event_fd;  /* −1 if no event connection is open */
    struct property properties[5];
    GPtrArray *objects; /* of struct object */
    guint32 last_handle;
    GArray *events; /* of struct event */
    struct virtual_ptpip_faults faults;
    struct virtual_ptpip_state state;
};

static void put(GByteArray *to, int bytes, guint64 value) {
    for (int i = 0; i < bytes; i++) {
        const guint8 byte = (guint8)(value >> 8 * i);
        g_byte_array_append(to, &byte, 1);
    }
}

/* Appends a text as PTP writes it: the number of characters with the final zero, then UTF-16. */
static void put_text(GByteArray *to, const char *text) {
    const gsize n = strlen(text);
    put(to, 1, n ? n + 1 : 0);
    for (gsize i = 0; n && i <= n; i++)
        put(to, 2, (guint8)text[i]);
}

static void put_codes(GByteArray *to, const guint16 *codes, gsize n) {
    put(to, 4, n);
    for (gsize i = 0; i < n; i++)
        put(to, 2, codes[i]);
}

static guint32 get(const guint8 *at, int bytes) {
    guint32 value = 0;
    for (int i = 0; i < bytes; i++)
        value |= (guint32)at[i] << 8 * i;
    return value;
}

static void object_free(gpointer data) {
    struct object *object = data;
    g_free(object->name);
    g_bytes_unref(object->data);
    g_free(object->date);
    g_free(object);
}

static gboolean send_all(int fd, const guint8 *bytes, gsize n) {
    while (n > 0) {
        const gssize sent = send(fd, bytes, n, MSG_NOSIGNAL);
        if (sent <= 0)
            return FALSE;
        bytes += sent;
        n -= (gsize)sent;
    }
    return TRUE;
}

static gboolean send_packet(int fd, guint32 type, const GByteArray *payload) {
    g_autoptr(GByteArray) packet = g_byte_array_new();
    put(packet, 4, payload->len + 8);
    put(packet, 4, type);
    g_byte_array_append(packet, payload->data, payload->len);
    return send_all(fd, packet->data, packet->len);
}

static gboolean receive(int fd, guint8 *bytes, gsize n) {
    while (n > 0) {
        const gssize got = recv(fd, bytes, n, 0);
        if (got <= 0)
            return FALSE;
        bytes += got;
        n -= (gsize)got;
    }
    return TRUE;
}

/* Receives a packet. Returns its payload, and sets *ret_type to its type. Returns NULL at the end
 * of the connection, or if the length of the packet is not possible. */
static GByteArray *receive_packet(int fd, guint32 *ret_type) {
    guint8 head[8];
    if (!receive(fd, head, sizeof head))
        return NULL;
    const guint32 length = get(head, 4);
    if (length < 8 || length > MAX_SENT)
        return NULL;
    g_autoptr(GByteArray) payload = g_byte_array_new();
    g_byte_array_set_size(payload, length - 8);
    *ret_type = get(head + 4, 4);
    return receive(fd, payload->data, payload->len) ? g_steal_pointer(&payload) : NULL;
}

/* Call the functions below with the mutex locked, unless their comment says otherwise. */

static void send_event(VirtualPtpip *camera, guint16 code, guint32 parameter) {
    const struct event event = {code, parameter};
    if (camera->options.nikon) {
        g_array_append_val(camera->events, event);
        return;
    }
    if (camera->event_fd < 0)
        return;
    g_autoptr(GByteArray) payload = g_byte_array_new();
    put(payload, 2, code);
    put(payload, 4, 0);
    put(payload, 4, parameter);
    send_packet(camera->event_fd, EVENT, payload);
}

static struct property *find_property(VirtualPtpip *camera, guint32 code) {
    for (gsize i = 0; i < G_N_ELEMENTS(camera->properties); i++)
        if (camera->properties[i].code == code)
            return &camera->properties[i];
    return NULL;
}

static struct object *find_object(VirtualPtpip *camera, guint32 handle) {
    for (guint i = 0; i < camera->objects->len; i++)
        if (((struct object *)camera->objects->pdata[i])->handle == handle)
            return camera->objects->pdata[i];
    return NULL;
}

/* Adds a file to the card. Takes ownership of name and data. Returns the file's handle. */
static guint32 add_object(VirtualPtpip *camera, char *name, guint16 format, GBytes *data) {
    struct object *object = g_new0(struct object, 1);
    g_autoptr(GDateTime) now = g_date_time_new_now_local();
    *object = (struct object){++camera->last_handle, name, format, data,
                              g_date_time_format(now, "%Y%m%dT%H%M%S")};
    g_ptr_array_add(camera->objects, object);
    return object->handle;
}

static gboolean take_fault(int *fault) {
    if (*fault <= 0)
        return FALSE;
    --*fault;
    return TRUE;
}

static void end_connections(VirtualPtpip *camera) {
    for (guint i = 0; i < camera->fds->len; i++)
        shutdown(g_array_index(camera->fds, int, i), SHUT_RDWR);
    camera->event_fd = -1;
}

/* Returns the values of the sensor. The mutex must not be locked. */
static guint16 *make_picture(const VirtualPtpip *camera, const struct virtual_exposure *exposure) {
    const struct virtual_ptpip_options *options = &camera->options;
    const gsize n = (gsize)options->width * (gsize)options->height;
    guint16 *values = g_new0(guint16, n);
    if (options->picture)
        options->picture(exposure, options->data, values);
    for (gsize i = 0; !options->picture && i < n; i++)
        values[i] = (guint16)((i % (gsize)options->width * 3 + i / (gsize)options->width * 7 +
                               exposure->n * 11) &
                              ((1u << options->bits) - 1));
    return values;
}

static GBytes *make_raw(const VirtualPtpip *camera, const guint16 *values) {
    const struct virtual_ptpip_options *options = &camera->options;
    const guint32 black = (guint32)lround(options->black_level);
    const struct dng dng = {.width = options->width,
                            .height = options->height,
                            .values = values,
                            .cfa = cfa_name(options->cfa),
                            .black = {black, black, black, black},
                            .white = (1u << options->bits) - 1};
    return dng_new(&dng);
}

/* Returns a grey JPEG. Its values are encoded as sRGB, as in the JPEG files of cameras. */
static GBytes *make_jpeg(const VirtualPtpip *camera, const guint16 *values) {
    const struct virtual_ptpip_options *options = &camera->options;
    struct jpeg_compress_struct jpeg = {0};
    struct jpeg_error_mgr errors;
    unsigned char *bytes = NULL;
    unsigned long length = 0;
    g_autofree guint8 *row = g_malloc((gsize)options->width);
    jpeg.err = jpeg_std_error(&errors);
    jpeg_create_compress(&jpeg);
    jpeg_mem_dest(&jpeg, &bytes, &length);
    jpeg.image_width = (JDIMENSION)options->width;
    jpeg.image_height = (JDIMENSION)options->height;
    jpeg.input_components = 1;
    jpeg.in_color_space = JCS_GRAYSCALE;
    jpeg_set_defaults(&jpeg);
    jpeg_set_quality(&jpeg, 100, TRUE);
    jpeg_start_compress(&jpeg, TRUE);
    for (int y = 0; y < options->height; y++) {
        for (int x = 0; x < options->width; x++) {
            const double value = values[(gsize)y * (gsize)options->width + (gsize)x];
            const double white = (1 << options->bits) - 1;
            const double light =
                MAX(value - options->black_level, 0) / (white - options->black_level);
            const double code =
                light <= 0.0031308 ? 12.92 * light : 1.055 * pow(light, 1 / 2.4) - 0.055;
            row[x] = (guint8)lround(255 * code);
        }
        JSAMPROW rows[] = {row};
        jpeg_write_scanlines(&jpeg, rows, 1);
    }
    jpeg_finish_compress(&jpeg);
    jpeg_destroy_compress(&jpeg);
    GBytes *file = g_bytes_new(bytes, length);
    free(bytes);
    return file;
}

struct shot {
    VirtualPtpip *camera;
    struct virtual_exposure exposure;
    gboolean incomplete, unsaid, late;
};

static void end_thread(VirtualPtpip *camera) {
    camera->n_threads--;
    g_cond_broadcast(&camera->cond);
    g_mutex_unlock(&camera->mutex);
}

static void wait_until(VirtualPtpip *camera, gint64 until_us) {
    while (!camera->quit && g_cond_wait_until(&camera->cond, &camera->mutex, until_us))
        ;
}

static void say_added(VirtualPtpip *camera, guint32 handle) {
    send_event(camera, handle == MEMORY_HANDLE ? NIKON_ADDED_IN_MEMORY : OBJECT_ADDED, handle);
}

/* Moves a new picture from the card to the camera's memory. An earlier picture in the memory is
 * replaced. */
static guint32 move_to_memory(VirtualPtpip *camera, guint32 handle) {
    struct object *old = find_object(camera, MEMORY_HANDLE);
    if (old)
        g_ptr_array_remove(camera->objects, old);
    find_object(camera, handle)->handle = MEMORY_HANDLE;
    return MEMORY_HANDLE;
}

static gpointer expose(gpointer data) {
    g_autofree struct shot *shot = data;
    VirtualPtpip *camera = shot->camera;
    const struct virtual_exposure *exposure = &shot->exposure;
    guint32 first = 0, second = 0;
    g_mutex_lock(&camera->mutex);
    wait_until(camera, exposure->start_us + exposure->exposure_us);
    g_mutex_unlock(&camera->mutex);
    g_autofree guint16 *values = make_picture(camera, exposure);
    const gboolean raw = !camera->options.jpeg;
    GBytes *picture = raw ? make_raw(camera, values) : make_jpeg(camera, values);
    GBytes *also = camera->options.both ? make_jpeg(camera, values) : NULL;
    g_mutex_lock(&camera->mutex);
    const int number = ++camera->state.pictures * !camera->faults.same_name;
    if (also)
        first = add_object(camera, g_strdup_printf("DSC_%04d.JPG", number), FORMAT_JPEG, also);
    second = add_object(camera, g_strdup_printf("DSC_%04d.%s", number, raw ? "DNG" : "JPG"),
                        raw ? FORMAT_DNG : FORMAT_JPEG, picture);
    if (camera->options.memory)
        second = move_to_memory(camera, second);
    camera->exposing = FALSE;
    const gboolean first_complete = camera->faults.complete_first || shot->late;
    if (first_complete && !shot->incomplete)
        send_event(camera, CAPTURE_COMPLETE, 0);
    if (shot->late)
        wait_until(camera, g_get_monotonic_time() + (gint64)(camera->faults.late_exposures *
                                                             (double)exposure->exposure_us));
    if (!shot->unsaid && !camera->quit) {
        if (first)
            say_added(camera, first);
        say_added(camera, second);
    }
    if (!first_complete && !shot->incomplete)
        send_event(camera, CAPTURE_COMPLETE, 0);
    end_thread(camera);
    return NULL;
}

/* Begins an exposure. Returns the response. */
static guint16 trigger(VirtualPtpip *camera) {
    if (camera->exposing || take_fault(&camera->faults.busy))
        return BUSY;
    if (camera->faults.full) {
        send_event(camera, STORE_FULL_EVENT, STORE);
        return STORE_FULL;
    }
    camera->state.triggers++;
    if (take_fault(&camera->faults.blind))
        return RESPONSE_OK;
    struct shot *shot = g_new0(struct shot, 1);
    *shot = (struct shot){
        .camera = camera,
        .exposure = {.n = (guint64)camera->state.triggers,
                     .start_us = g_get_monotonic_time() + camera->faults.slow_us,
                     .exposure_us = find_property(camera, SHUTTER)->value * SHUTTER_US},
        .incomplete = take_fault(&camera->faults.incomplete),
        .unsaid = take_fault(&camera->faults.unsaid),
        .late = take_fault(&camera->faults.late)};
    camera->exposing = TRUE;
    camera->n_threads++;
    g_thread_unref(g_thread_new("virtual-shot", expose, shot));
    return RESPONSE_OK;
}

static void put_device_info(const VirtualPtpip *camera, GByteArray *to) {
    static const guint16 operations[] = {
        GET_DEVICE_INFO, OPEN_SESSION,       CLOSE_SESSION,     GET_STORAGE_IDS, GET_STORAGE_INFO,
        GET_NUM_OBJECTS, GET_OBJECT_HANDLES, GET_OBJECT_INFO,   GET_OBJECT,      GET_THUMB,
        DELETE_OBJECT,   INITIATE_CAPTURE,   GET_PROPERTY_DESC, GET_PROPERTY,    SET_PROPERTY,
        NIKON_GET_EVENT, NIKON_DEVICE_READY, NIKON_CAPTURE};
    static const guint16 events[] = {OBJECT_ADDED, PROPERTY_CHANGED, STORE_FULL_EVENT,
                                     CAPTURE_COMPLETE};
    static const guint16 properties[] = {BATTERY, APERTURE, SHUTTER, MODE, ISO};
    static const guint16 captures[] = {FORMAT_JPEG}, images[] = {FORMAT_FOLDER, FORMAT_JPEG};
    const gboolean nikon = camera->options.nikon;
    put(to, 2, 100);
    put(to, 4, nikon ? 0xa : 0xffffffff);
    put(to, 2, 100);
    put_text(to, "");
    put(to, 2, 0);
    put_codes(to, operations, G_N_ELEMENTS(operations) - (nikon ? 0 : 3));
    put_codes(to, events, G_N_ELEMENTS(events));
    put_codes(to, properties, G_N_ELEMENTS(properties));
    put_codes(to, captures, G_N_ELEMENTS(captures));
    put_codes(to, images, G_N_ELEMENTS(images));
    put_text(to, nikon ? "Nikon Corporation" : "Mesorig");
    put_text(to, "Virtual Camera");
    put_text(to, "1.0");
    put_text(to, camera->serial);
}

static void put_storage_info(const VirtualPtpip *camera, GByteArray *to) {
    put(to, 2, 4); /* a removable card */
    put(to, 2, 3); /* folders as in DCF */
    put(to, 2, 0);
    put(to, 8, G_GUINT64_CONSTANT(1) << 34);
    put(to, 8, camera->faults.full ? 0 : G_GUINT64_CONSTANT(1) << 33);
    put(to, 4, camera->faults.full ? 0 : 999);
    put_text(to, "Card");
    put_text(to, "CARD");
}

static void put_object_info(const struct object *object, GByteArray *to) {
    const gboolean folder = object->format == FORMAT_FOLDER;
    put(to, 4, STORE);
    put(to, 2, object->format);
    put(to, 2, 0);
    put(to, 4, g_bytes_get_size(object->data));
    put(to, 2, 0); /* there is no thumbnail */
    for (int i = 0; i < 3; i++)
        put(to, 4, 0);
    put(to, 4, 64); /* width, height and bits per pixel of the picture */
    put(to, 4, 48);
    put(to, 4, 24);
    put(to, 4, folder ? 0 : FOLDER_HANDLE);
    put(to, 2, folder ? 1 : 0);
    put(to, 8, 0);
    put_text(to, object->name);
    put_text(to, object->date);
    put_text(to, object->date);
    put_text(to, "");
}

static void put_value(GByteArray *to, const struct property *property, guint32 value) {
    put(to, property->type == TYPE_UINT8 ? 1 : property->type == TYPE_UINT16 ? 2 : 4, value);
}

static void put_property(GByteArray *to, const struct property *property) {
    put(to, 2, property->code);
    put(to, 2, (guint64)property->type);
    put(to, 1, property->code != BATTERY);
    put_value(to, property, property->value);
    put_value(to, property, property->value);
    if (property->code == BATTERY) { /* a range */
        put(to, 1, 1);
        put_value(to, property, 0);
        put_value(to, property, 100);
        put_value(to, property, 1);
        return;
    }
    put(to, 1, 2); /* a list */
    put(to, 2, property->n);
    for (gsize i = 0; i < property->n; i++)
        put_value(to, property, property->choices[i]);
}

static void set_property(VirtualPtpip *camera, struct property *property, guint32 value) {
    if (property->code == SHUTTER && camera->faults.neighbour)
        for (gsize i = 0; i + 1 < property->n; i++)
            if (property->choices[i] == value) {
                value = property->choices[i + 1];
                break;
            }
    property->value = value;
    send_event(camera, PROPERTY_CHANGED, property->code);
}

static void put_handles(const VirtualPtpip *camera, guint32 parent, GByteArray *to) {
    guint n = 0;
    const guint at = to->len;
    put(to, 4, 0);
    for (guint i = 0; i < camera->objects->len; i++) {
        const struct object *object = camera->objects->pdata[i];
        const guint32 in = object->format == FORMAT_FOLDER ? 0 : FOLDER_HANDLE;
        if (object->handle == MEMORY_HANDLE)
            continue;
        if (parent != 0 && in != (parent == 0xffffffff ? 0 : parent))
            continue;
        put(to, 4, object->handle);
        n++;
    }
    memcpy(to->data + at, &(guint32){GUINT32_TO_LE(n)}, 4);
}

static void put_events(VirtualPtpip *camera, GByteArray *to) {
    put(to, 2, camera->events->len);
    for (guint i = 0; i < camera->events->len; i++) {
        const struct event *event = &g_array_index(camera->events, struct event, i);
        put(to, 2, event->code);
        put(to, 4, event->parameter);
    }
    g_array_set_size(camera->events, 0);
}

struct operation {
    guint16 code;
    guint32 transaction, parameters[3];
    GByteArray *sent; /* data that the computer has sent */
};

/* Carries out an operation, and returns the code of the response. Sets *ret_data to whether the
 * camera sends data, which are then appended to data. */
static guint16 obey(VirtualPtpip *camera, const struct operation *operation, GByteArray *data,
                    gboolean *ret_data) {
    const guint32 parameter = operation->parameters[0];
    struct property *property = find_property(camera, parameter);
    struct object *object = find_object(camera, parameter);
    *ret_data = TRUE;
    switch (operation->code) {
    case GET_DEVICE_INFO:
        put_device_info(camera, data);
        return RESPONSE_OK;
    case GET_STORAGE_IDS:
        put(data, 4, 1);
        put(data, 4, STORE);
        return RESPONSE_OK;
    case GET_STORAGE_INFO:
        put_storage_info(camera, data);
        return RESPONSE_OK;
    case GET_OBJECT_HANDLES:
        put_handles(camera, operation->parameters[2], data);
        return RESPONSE_OK;
    case GET_OBJECT_INFO:
        if (!object)
            break;
        put_object_info(object, data);
        return RESPONSE_OK;
    case GET_OBJECT:
        if (!object)
            break;
        g_byte_array_append(data, g_bytes_get_data(object->data, NULL),
                            (guint)g_bytes_get_size(object->data));
        if (parameter == MEMORY_HANDLE)
            g_ptr_array_remove(camera->objects, object);
        return RESPONSE_OK;
    case GET_PROPERTY_DESC:
    case GET_PROPERTY:
        if (!property)
            break;
        if (property->code == BATTERY)
            property->value = camera->faults.battery ? (guint32)camera->faults.battery : 80;
        if (operation->code == GET_PROPERTY)
            put_value(data, property, property->value);
        else
            put_property(data, property);
        return RESPONSE_OK;
    case NIKON_GET_EVENT:
        put_events(camera, data);
        return RESPONSE_OK;
    default:
        break;
    }
    *ret_data = FALSE;
    switch (operation->code) {
    case OPEN_SESSION:
    case CLOSE_SESSION:
    case GET_NUM_OBJECTS:
    case NIKON_CHANGE_MODE:
        return RESPONSE_OK;
    case NIKON_DEVICE_READY:
        return camera->exposing ? BUSY : RESPONSE_OK;
    case INITIATE_CAPTURE:
    case NIKON_CAPTURE:
        return trigger(camera);
    case DELETE_OBJECT:
        return object && g_ptr_array_remove(camera->objects, object) ? RESPONSE_OK : BAD_HANDLE;
    case SET_PROPERTY:
        if (!property || operation->sent->len == 0)
            return BAD_PROPERTY;
        set_property(camera, property,
                     get(operation->sent->data, MIN((int)operation->sent->len, 4)));
        return RESPONSE_OK;
    case GET_THUMB:
        return NO_THUMB;
    case GET_PROPERTY_DESC:
    case GET_PROPERTY:
        return BAD_PROPERTY;
    case GET_OBJECT_INFO:
    case GET_OBJECT:
        return BAD_HANDLE;
    default:
        return NOT_SUPPORTED;
    }
}

/* Sends the data of an operation. If half is TRUE, sends only half of the first packet of the data,
 * and no end packet. Returns FALSE if the connection has ended. The mutex must not be locked. */
static gboolean send_data(int fd, guint32 transaction, const GByteArray *data, gboolean half) {
    const guint chunk = MAX_PACKET - 12;
    g_autoptr(GByteArray) start = g_byte_array_new();
    put(start, 4, transaction);
    put(start, 8, data->len);
    if (!send_packet(fd, START_DATA, start))
        return FALSE;
    for (guint at = 0; at <= data->len; at += chunk) {
        const guint n = MIN(chunk, data->len - at) / (half ? 2 : 1);
        g_autoptr(GByteArray) part = g_byte_array_new();
        put(part, 4, transaction);
        g_byte_array_append(part, data->data + at, n);
        const gboolean last = at + chunk >= data->len;
        if (!send_packet(fd, last && !half ? END_DATA : DATA, part))
            return FALSE;
        if (last || half)
            break;
    }
    return TRUE;
}

/* Reads the data that follow a request. Returns FALSE at the end of the connection, or if a packet
 * is too short. */
static gboolean receive_data(int fd, GByteArray *to) {
    for (guint32 type = 0; type != END_DATA;) {
        g_autoptr(GByteArray) payload = receive_packet(fd, &type);
        if (!payload || payload->len < 4)
            return FALSE;
        if (type == DATA || type == END_DATA)
            g_byte_array_append(to, payload->data + 4, payload->len - 4);
    }
    return TRUE;
}

/* Reads everything that arrives and answers nothing, until the connection ends. */
static void ignore(int fd) {
    guint8 bytes[256];
    while (recv(fd, bytes, sizeof bytes, 0) > 0)
        ;
}

/* Answers one request. Returns FALSE if the connection has ended. The mutex must not be locked. */
static gboolean serve_request(VirtualPtpip *camera, int fd, const GByteArray *request) {
    g_autoptr(GByteArray) sent = g_byte_array_new(), data = g_byte_array_new(),
                          response = g_byte_array_new();
    struct operation operation = {.sent = sent};
    gboolean has_data;
    if (request->len < 10)
        return FALSE;
    operation.code = (guint16)get(request->data + 4, 2);
    operation.transaction = get(request->data + 6, 4);
    for (guint i = 0; i < 3 && request->len >= 10 + 4 * (i + 1); i++)
        operation.parameters[i] = get(request->data + 10 + 4 * i, 4);
    if (get(request->data, 4) == 2 && !receive_data(fd, sent))
        return FALSE;
    g_mutex_lock(&camera->mutex);
    const gboolean download = operation.code == GET_OBJECT;
    const gboolean dropped = download && take_fault(&camera->faults.dropped);
    const gboolean stalled = download && take_fault(&camera->faults.stalled);
    const guint16 code = obey(camera, &operation, data, &has_data);
    const gboolean unanswered =
        (operation.code == INITIATE_CAPTURE || operation.code == NIKON_CAPTURE) &&
        take_fault(&camera->faults.unanswered);
    g_mutex_unlock(&camera->mutex);
    if (has_data && !send_data(fd, operation.transaction, data, dropped || stalled))
        return FALSE;
    if (dropped) {
        g_mutex_lock(&camera->mutex);
        end_connections(camera);
        g_mutex_unlock(&camera->mutex);
        return FALSE;
    }
    if (stalled || unanswered) {
        ignore(fd);
        return FALSE;
    }
    put(response, 2, code);
    put(response, 4, operation.transaction);
    return send_packet(fd, RESPONSE, response);
}

static gboolean greet(VirtualPtpip *camera, int fd, gboolean *ret_events) {
    guint32 type;
    g_autoptr(GByteArray) hello = receive_packet(fd, &type), answer = g_byte_array_new();
    if (!hello)
        return FALSE;
    g_mutex_lock(&camera->mutex);
    const gboolean refuses = camera->faults.refuses, deaf = camera->faults.deaf;
    *ret_events = type == INIT_EVENT;
    if (*ret_events)
        camera->event_fd = fd;
    else
        camera->state.connections++;
    g_mutex_unlock(&camera->mutex);
    if (deaf) {
        ignore(fd);
        return FALSE;
    }
    if (type == INIT_EVENT)
        return send_packet(fd, INIT_EVENT_ACK, answer);
    if (type != INIT_COMMAND || refuses) {
        put(answer, 4, 1);
        send_packet(fd, INIT_FAIL, answer);
        return FALSE;
    }
    put(answer, 4, 1);
    for (int i = 0; i < 16; i++)
        put(answer, 1, (guint64)i);
    for (const char *c = "Virtual Camera"; *c; c++)
        put(answer, 2, (guint8)*c);
    put(answer, 2, 0);
    put(answer, 4, 0x10000);
    return send_packet(fd, INIT_COMMAND_ACK, answer);
}

struct connection {
    VirtualPtpip *camera;
    int fd;
};

static gpointer serve(gpointer data) {
    g_autofree struct connection *connection = data;
    VirtualPtpip *camera = connection->camera;
    const int fd = connection->fd;
    gboolean events = FALSE, open = greet(camera, fd, &events);
    while (open && events) /* nothing is asked on this connection */
        open = recv(fd, &(guint8){0}, 1, 0) > 0;
    while (open) {
        guint32 type;
        g_autoptr(GByteArray) payload = receive_packet(fd, &type);
        open = payload && (type != REQUEST || serve_request(camera, fd, payload));
    }
    g_mutex_lock(&camera->mutex);
    for (guint i = 0; i < camera->fds->len; i++)
        if (g_array_index(camera->fds, int, i) == fd)
            g_array_remove_index_fast(camera->fds, i--);
    if (camera->event_fd == fd)
        camera->event_fd = -1;
    close(fd);
    end_thread(camera);
    return NULL;
}

/* Accepts a connection, and starts its thread. Called without the mutex. */
static void accept_one(VirtualPtpip *camera) {
    const int one = 1, fd = accept4(camera->listener, NULL, NULL, SOCK_CLOEXEC);
    if (fd < 0)
        return;
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&camera->mutex);
    if (camera->faults.unplugged || camera->quit) {
        close(fd);
        return;
    }
    struct connection *connection = g_new(struct connection, 1);
    *connection = (struct connection){camera, fd};
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
    g_array_append_val(camera->fds, fd);
    camera->n_threads++;
    g_thread_unref(g_thread_new("virtual-ptpip", serve, connection));
}

static gpointer accept_all(gpointer data) {
    VirtualPtpip *camera = data;
    for (;;) {
        struct pollfd ready[] = {{camera->listener, POLLIN, 0}, {camera->wake[0], POLLIN, 0}};
        if (poll(ready, G_N_ELEMENTS(ready), -1) < 0 && errno != EINTR)
            return NULL;
        if (ready[1].revents)
            return NULL;
        if (ready[0].revents)
            accept_one(camera);
    }
}

static gboolean listen_at(VirtualPtpip *camera, GError **error) {
    struct sockaddr_in at = {.sin_family = AF_INET};
    socklen_t size = sizeof at;
    if (inet_pton(AF_INET, camera->host, &at.sin_addr) != 1) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_ARGUMENT,
                    "virtual camera %s: this is not an IPv4 address; give one such as 127.0.0.1",
                    camera->host);
        return FALSE;
    }
    if (pipe2(camera->wake, O_CLOEXEC) != 0) {
        g_set_error(error, G_IO_ERROR, g_io_error_from_errno(errno),
                    "virtual camera %s: no pipe can be made: %s; close other programs",
                    camera->host, g_strerror(errno));
        return FALSE;
    }
    camera->listener = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (camera->listener < 0 || bind(camera->listener, (struct sockaddr *)&at, sizeof at) != 0 ||
        listen(camera->listener, 8) != 0 ||
        getsockname(camera->listener, (struct sockaddr *)&at, &size) != 0) {
        g_set_error(error, G_IO_ERROR, g_io_error_from_errno(errno),
                    "virtual camera %s: no socket can be opened at this address: %s; give an "
                    "address of this computer, such as 127.0.0.1",
                    camera->host, g_strerror(errno));
        return FALSE;
    }
    const int port = ntohs(at.sin_port);
    camera->port = g_strdup_printf("ptpip:%s:%d:%d", camera->host, port, port);
    return TRUE;
}

VirtualPtpip *virtual_ptpip_new(const struct virtual_ptpip_options *options, GError **error) {
    VirtualPtpip *camera = g_new0(VirtualPtpip, 1);
    const struct property properties[] = {
        {BATTERY, TYPE_UINT8, 80, NULL, 0},
        {APERTURE, TYPE_UINT16, 800, apertures, G_N_ELEMENTS(apertures)},
        {SHUTTER, TYPE_UINT32, 100, shutters, G_N_ELEMENTS(shutters)},
        {MODE, TYPE_UINT16, 1, modes, G_N_ELEMENTS(modes)},
        {ISO, TYPE_UINT16, 100, isos, G_N_ELEMENTS(isos)}};
    camera->options = *options;
    camera->host = g_strdup(options->host ? options->host : "127.0.0.1");
    camera->serial = g_strdup(options->serial ? options->serial : "");
    camera->listener = camera->event_fd = camera->wake[0] = camera->wake[1] = -1;
    memcpy(camera->properties, properties, sizeof properties);
    g_mutex_init(&camera->mutex);
    g_cond_init(&camera->cond);
    camera->fds = g_array_new(FALSE, FALSE, sizeof(int));
    camera->events = g_array_new(FALSE, FALSE, sizeof(struct event));
    camera->objects = g_ptr_array_new_with_free_func(object_free);
    camera->last_handle = FOLDER_HANDLE - 1;
    add_object(camera, g_strdup(FOLDER_NAME), FORMAT_FOLDER, g_bytes_new(NULL, 0));
    camera->last_handle = 0;
    if (!listen_at(camera, error)) {
        virtual_ptpip_free(camera);
        return NULL;
    }
    camera->acceptor = g_thread_new("virtual-ptpip", accept_all, camera);
    return camera;
}

void virtual_ptpip_free(VirtualPtpip *camera) {
    if (!camera)
        return;
    if (camera->acceptor) {
        if (write(camera->wake[1], "", 1) < 0)
            g_warning("virtual camera %s: the camera's thread cannot be woken: %s", camera->host,
                      g_strerror(errno));
        g_thread_join(camera->acceptor);
    }
    g_mutex_lock(&camera->mutex);
    camera->quit = TRUE;
    end_connections(camera);
    g_cond_broadcast(&camera->cond);
    while (camera->n_threads > 0)
        g_cond_wait(&camera->cond, &camera->mutex);
    g_mutex_unlock(&camera->mutex);
    const int fds[] = {camera->listener, camera->wake[0], camera->wake[1]};
    for (gsize i = 0; i < G_N_ELEMENTS(fds); i++)
        if (fds[i] >= 0)
            close(fds[i]);
    g_array_unref(camera->fds);
    g_array_unref(camera->events);
    g_ptr_array_unref(camera->objects);
    g_mutex_clear(&camera->mutex);
    g_cond_clear(&camera->cond);
    g_free(camera->host);
    g_free(camera->serial);
    g_free(camera->port);
    g_free(camera);
}

const char *virtual_ptpip_port(const VirtualPtpip *camera) {
    return camera->port;
}

void virtual_ptpip_fail(VirtualPtpip *camera, const struct virtual_ptpip_faults *faults) {
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&camera->mutex);
    camera->faults = *faults;
    if (faults->unplugged || faults->deaf)
        end_connections(camera);
}

void virtual_ptpip_state(VirtualPtpip *camera, struct virtual_ptpip_state *ret) {
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&camera->mutex);
    *ret = camera->state;
    ret->on_card = (int)camera->objects->len - 1 -
                   (find_object(camera, MEMORY_HANDLE) != NULL); /* without the folder */
    ret->shutter_us = find_property(camera, SHUTTER)->value * SHUTTER_US;
    ret->iso = (int)find_property(camera, ISO)->value;
}

void virtual_ptpip_turn_dials(VirtualPtpip *camera, gint64 shutter_us, int iso) {
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&camera->mutex);
    const struct {
        guint16 code;
        guint32 value;
    } dials[] = {{SHUTTER, (guint32)(shutter_us / SHUTTER_US)}, {ISO, (guint32)iso}};
    for (gsize i = 0; i < G_N_ELEMENTS(dials); i++) {
        find_property(camera, dials[i].code)->value = dials[i].value;
        send_event(camera, PROPERTY_CHANGED, dials[i].code);
    }
}

void virtual_ptpip_put(VirtualPtpip *camera, const char *name, const char *date, gboolean says) {
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&camera->mutex);
    const guint32 handle =
        add_object(camera, g_strdup(name), FORMAT_DNG, g_bytes_new("by hand", 7));
    struct object *object = find_object(camera, handle);
    if (date) {
        g_free(object->date);
        object->date = g_strdup(date);
    }
    if (says)
        say_added(camera, handle);
}
