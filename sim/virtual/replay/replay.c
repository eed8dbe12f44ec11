#include "replay.h"

#include "steps.h"

#include "virtual/dmx_node.h"
#include "virtual/terminal.h"
#include "virtual/usb_device.h"

#include <arpa/inet.h>
#include <errno.h>
#include <gio/gio.h>
#include <glib/gstdio.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#define TICK_MS     5
#define MAX_REQUEST 65536
/* time in ms from the opening of the port to the greeting; a driver ignores what comes earlier */
#define GREETING_MS 100
#define MBAP_SIZE   6 /* bytes of the header of Modbus TCP before the unit */
/* number of the computer's address (virtual_dmx_address()); devices have the numbers 1 to 7 */
#define COMPUTER    0
#define MAX_DEVICES 7

struct bus {
    Replay *replay;
    const char *kind;
    char *place; /* value of the key in the section */
    struct steps *steps;
    GThread *thread;
    struct terminal terminal;
    int listens, fd; /* −1 if there is none */
    int http_port;
    /* For a serial bus: time when the port was first opened. 0 before that, and −1 after the
     * greeting. */
    gint64 opened_us;
    GByteArray *input;
    struct virtual_usb_class usb_class;
    char *usb_name;
    VirtualUsb *usb;
};

struct Replay {
    const Recorded *recorded;
    const char *pipe;
    char *folder, *sections;
    GPtrArray *buses; /* of struct bus */
    GMutex mutex;     /* guards the steps */
    gint quits;       /* atomic */
};

static enum steps_result take(struct bus *bus, const guint8 *bytes, gsize n, GPtrArray *ret) {
    g_mutex_lock(&bus->replay->mutex);
    const enum steps_result result = steps_take(bus->steps, bytes, n, ret);
    g_mutex_unlock(&bus->replay->mutex);
    return result;
}

static void write_all(int fd, const guint8 *bytes, gsize n) {
    while (n > 0) {
        const gssize done = write(fd, bytes, n);
        if (done < 0 && errno == EAGAIN) {
            g_usleep(1000);
            continue;
        }
        if (done < 0)
            return; /* the program has closed its end */
        bytes += done;
        n -= (gsize)done;
    }
}

static void write_message(int fd, GBytes *message) {
    gsize n;
    const guint8 *bytes = g_bytes_get_data(message, &n);
    write_all(fd, bytes, n);
}

/* Sends an answer of Modbus TCP. Its header has the transaction id of the request and the length of
 * the answer. */
static void write_modbus(int fd, const guint8 *request, GBytes *message) {
    gsize n;
    const guint8 *bytes = g_bytes_get_data(message, &n);
    guint8 whole[MBAP_SIZE + 260];
    if (n > sizeof whole - MBAP_SIZE)
        return;
    memcpy(whole, request, 4);
    whole[4] = (guint8)(n >> 8);
    whole[5] = (guint8)n;
    memcpy(whole + MBAP_SIZE, bytes, n);
    write_all(fd, whole, MBAP_SIZE + n);
}

/* Answers a request by HTTP. The recorded message has the form "STATUS BODY". */
static void write_http(int fd, GBytes *message) {
    gsize n;
    const char *bytes = g_bytes_get_data(message, &n);
    g_autofree char *text = g_strchomp(g_strndup(bytes, n));
    char *body;
    const guint64 status = g_ascii_strtoull(text, &body, 10);
    g_autoptr(GString) with = g_string_new(*body ? body + 1 : "");
    g_string_replace(with, "{computer}", virtual_dmx_address(COMPUTER), 0);
    g_autofree char *whole = g_strdup_printf(
        "HTTP/1.1 %d said\r\nContent-Type: application/json\r\nContent-Length: %zu\r\n"
        "Connection: close\r\n\r\n%s",
        (int)status, with->len, with->str);
    write_all(fd, (const guint8 *)whole, strlen(whole));
}

/* Returns the length of a request by HTTP, or 0 if the request is not complete. Sets *ret_text to
 * the request as it is written in a recording. Free the text with g_free(). */
static gsize cut_http(const char *bytes, gsize n, char **ret_text) {
    const char *body = g_strstr_len(bytes, (gssize)n, "\r\n\r\n");
    if (!body)
        return 0;
    body += 4;
    g_autofree char *head = g_strndup(bytes, (gsize)(body - bytes));
    const char *length = strcasestr(head, "\r\nContent-Length:");
    const gsize size = length ? (gsize)g_ascii_strtoull(length + 17, NULL, 10) : 0;
    if ((gsize)(body - bytes) + size > n)
        return 0;
    char *version = strstr(head, " HTTP/");
    if (version)
        *version = 0;
    *ret_text =
        size ? g_strdup_printf("%s %.*s\n", head, (int)size, body) : g_strdup_printf("%s\n", head);
    return (gsize)(body - bytes) + size;
}

/* Removes the first request from the input of a connection, and answers it. Returns FALSE if there
 * is none. */
static gboolean take_first(struct bus *bus, const struct replay_protocol *protocol) {
    const char *bytes = (const char *)bus->input->data;
    const gsize n = bus->input->len;
    g_autoptr(GPtrArray) answers = g_ptr_array_new_with_free_func((GDestroyNotify)g_bytes_unref);
    g_autofree char *text = NULL;
    gsize length = 0, skip = 0;
    const gboolean modbus = strcmp(bus->kind, "modbus") == 0;
    const gboolean http = strcmp(bus->kind, "http") == 0;
    if (n == 0)
        return FALSE;
    if (http) {
        length = cut_http(bytes, n, &text);
    } else if (modbus && n >= MBAP_SIZE) {
        length = MBAP_SIZE + ((gsize)(guint8)bytes[4] << 8 | (guint8)bytes[5]);
        length = length <= n ? length : 0;
        skip = MBAP_SIZE;
    } else if (!modbus) {
        length = protocol->cut(bytes, n);
    }
    if (length == 0)
        return FALSE;
    const guint8 *request = http ? (const guint8 *)text : (const guint8 *)bytes + skip;
    const gsize size = http ? strlen(text) : length - skip;
    if (take(bus, request, size, answers) != STEPS_ANSWERED)
        g_ptr_array_set_size(answers, 0);
    for (guint i = 0; i < answers->len; i++) {
        if (modbus)
            write_modbus(bus->fd, bus->input->data, answers->pdata[i]);
        else if (http)
            write_http(bus->fd, answers->pdata[i]);
        else
            write_message(bus->fd, answers->pdata[i]);
    }
    g_byte_array_remove_range(bus->input, 0, (guint)length);
    return TRUE;
}

static void hang_up(struct bus *bus) {
    if (bus->listens >= 0 && bus->fd >= 0) {
        close(bus->fd);
        bus->fd = -1;
    }
    g_byte_array_set_size(bus->input, 0);
}

/* Reads from a serial line or a connection, and answers. */
static void serve_stream(struct bus *bus, const struct replay_protocol *protocol) {
    guint8 bytes[4096];
    const gssize n = read(bus->fd, bytes, sizeof bytes);
    if (n == 0 || (n < 0 && errno != EAGAIN)) {
        hang_up(bus);
        return;
    }
    if (n > 0 && bus->input->len < MAX_REQUEST)
        g_byte_array_append(bus->input, bytes, (guint)n);
    while (take_first(bus, protocol))
        ;
    if (strcmp(bus->kind, "http") == 0 && bus->input->len == 0)
        hang_up(bus); /* “Connection: close” */
}

static void serve_udp(struct bus *bus) {
    guint8 bytes[2048];
    struct sockaddr_in from = {0};
    socklen_t length = sizeof from;
    const gssize n =
        recvfrom(bus->fd, bytes, sizeof bytes, MSG_DONTWAIT, (struct sockaddr *)&from, &length);
    g_autoptr(GPtrArray) answers = g_ptr_array_new_with_free_func((GDestroyNotify)g_bytes_unref);
    if (n <= 0 || take(bus, bytes, (gsize)n, answers) != STEPS_ANSWERED)
        return;
    for (guint i = 0; i < answers->len; i++) {
        gsize size;
        const guint8 *answer = g_bytes_get_data(answers->pdata[i], &size);
        sendto(bus->fd, answer, size, 0, (const struct sockaddr *)&from, length);
    }
}

/* Sends the recorded greeting: what the device sends when its port is opened. */
static void greet(struct bus *bus) {
    struct pollfd fd = {.fd = bus->fd};
    const GPtrArray *greeting = steps_greeting(bus->steps);
    const gint64 now = g_get_monotonic_time();
    if (greeting->len == 0 || bus->opened_us < 0)
        return;
    if (poll(&fd, 1, 0) > 0 && fd.revents & POLLHUP)
        return;
    if (bus->opened_us == 0)
        bus->opened_us = now;
    if (now < bus->opened_us + GREETING_MS * 1000)
        return;
    bus->opened_us = -1; /* once */
    for (guint i = 0; i < greeting->len; i++)
        write_message(bus->fd, greeting->pdata[i]);
}

static gpointer run(gpointer data) {
    struct bus *bus = data;
    const struct replay_protocol *protocol =
        replay_protocol_find(bus->kind, bus->replay->recorded->sections);
    const gboolean serial = strcmp(bus->kind, "serial") == 0;
    while (!g_atomic_int_get(&bus->replay->quits)) {
        struct pollfd fd = {.fd = bus->fd >= 0 ? bus->fd : bus->listens, .events = POLLIN};
        if (serial)
            greet(bus);
        if (poll(&fd, 1, TICK_MS) <= 0)
            continue;
        if (!(fd.revents & POLLIN) && serial) /* the port is not open */
            g_usleep(TICK_MS * 1000);
        else if (bus->fd < 0)
            bus->fd = accept(bus->listens, NULL, NULL);
        else if (strcmp(bus->kind, "udp") == 0)
            serve_udp(bus);
        else
            serve_stream(bus, protocol);
    }
    return NULL;
}

static int on_usb(gpointer model, const guint8 *setup, guint8 *data) {
    struct bus *bus = model;
    const gsize length = (gsize)(setup[6] | setup[7] << 8);
    const gboolean in = setup[0] & 0x80;
    g_autoptr(GByteArray) request = g_byte_array_new();
    g_autoptr(GPtrArray) answers = g_ptr_array_new_with_free_func((GDestroyNotify)g_bytes_unref);
    g_byte_array_append(request, setup, 8);
    if (!in)
        g_byte_array_append(request, data, (guint)length);
    if (take(bus, request->data, request->len, answers) != STEPS_ANSWERED ||
        (in && answers->len != 1))
        return -EPIPE;
    if (!in)
        return (int)length;
    gsize n;
    const guint8 *answer = g_bytes_get_data(answers->pdata[0], &n);
    n = MIN(n, length);
    memcpy(data, answer, n);
    return (int)n;
}

/* Makes the USB device of a note such as "1ffb:00b5 Tic T834". The device has one interface. It is
 * a HID interface if the name begins with USBRelay, and vendor-specific otherwise. */
static gboolean plug_usb(struct bus *bus, int number, GError **error) {
    static const guint8 vendor_specific[] = {9, 2, 18, 0, 1, 1,    0, 0xc0, 50,
                                             9, 4, 0,  0, 0, 0xff, 0, 0,    0};
    static const guint8 hid[] = {9, 2, 34,   0,    1, 1, 0, 0x80, 50, 9, 4, 0, 0,    1, 3, 0, 0,
                                 0, 9, 0x21, 0x11, 1, 0, 1, 0x22, 0,  0, 7, 5, 0x81, 3, 8, 0, 20};
    const Recorded *recorded = bus->replay->recorded;
    for (guint i = 0; i < recorded->lines->len; i++) {
        const struct recorded_line *line = recorded->lines->pdata[i];
        gsize n;
        const char *note = line->way == '-' ? g_bytes_get_data(line->bytes, &n) : NULL;
        if (line->bus != number || !note || n < 10 || note[4] != ':')
            continue;
        bus->usb_name = g_strndup(note + 10, n - 10);
        const gboolean is_hid = g_str_has_prefix(bus->usb_name, "USBRelay");
        bus->usb_class =
            (struct virtual_usb_class){.vendor = (guint16)g_ascii_strtoull(note, NULL, 16),
                                       .product = (guint16)g_ascii_strtoull(note + 5, NULL, 16),
                                       .name = bus->usb_name,
                                       .serial = "",
                                       .config = is_hid ? hid : vendor_specific,
                                       .config_size = is_hid ? sizeof hid : sizeof vendor_specific,
                                       .control = on_usb};
        bus->usb = virtual_usb_new(&bus->usb_class, MIN(number, 9), bus);
        return TRUE;
    }
    g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_DATA,
                "%s: no note names the USB device of @%d; record the device again", recorded->path,
                number);
    return FALSE;
}

static int listen_on(const struct sockaddr *address, socklen_t size) {
    const int fd = socket(address->sa_family, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (fd >= 0 && bind(fd, address, size) == 0 && listen(fd, 1) == 0)
        return fd;
    if (fd >= 0)
        close(fd);
    return -1;
}

static int tcp_port(int fd) {
    struct sockaddr_in address = {0};
    socklen_t length = sizeof address;
    getsockname(fd, (struct sockaddr *)&address, &length);
    return ntohs(address.sin_port);
}

/* Returns the UDP port of the device of a bus. The first message to the device shows whether this
 * is the port of Art-Net, sACN or WLED. */
static guint16 udp_port(const Recorded *recorded, int number) {
    for (guint i = 0; i < recorded->lines->len; i++) {
        const struct recorded_line *line = recorded->lines->pdata[i];
        gsize n;
        if (line->bus != number || line->way != '>')
            continue;
        const guint8 *bytes = g_bytes_get_data(line->bytes, &n);
        return n > 8 && memcmp(bytes, "Art-Net", 8) == 0 ? 6454 : n > 600 ? 5568 : 21324;
    }
    return 6454;
}

/* Returns the address of a device in the network. If the recording has a WLED, all buses have the
 * same address, because a WLED has two buses at one address. */
static const char *address_of(const Recorded *recorded, int number) {
    gboolean http = FALSE;
    for (guint i = 0; i < recorded->kinds->len; i++)
        http |= strcmp(recorded->kinds->pdata[i], "http") == 0;
    return virtual_dmx_address(http ? 1 : (number - 1) % MAX_DEVICES + 1);
}

static gboolean open_udp(struct bus *bus, int number) {
    const int yes = 1;
    struct sockaddr_in address = {.sin_family = AF_INET,
                                  .sin_port = htons(udp_port(bus->replay->recorded, number))};
    bus->place = g_strdup(address_of(bus->replay->recorded, number));
    inet_pton(AF_INET, bus->place, &address.sin_addr);
    bus->fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    return bus->fd >= 0 && setsockopt(bus->fd, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes) == 0 &&
           bind(bus->fd, (const struct sockaddr *)&address, sizeof address) == 0;
}

static gboolean open_tcp(struct bus *bus, const char *host) {
    struct sockaddr_in address = {.sin_family = AF_INET};
    inet_pton(AF_INET, host, &address.sin_addr);
    bus->listens = listen_on((const struct sockaddr *)&address, sizeof address);
    return bus->listens >= 0;
}

/* Makes the socket that the Python program connects to its standard input and output. */
static gboolean open_socket(struct bus *bus, int number) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    g_snprintf(address.sun_path, sizeof address.sun_path, "%s/%d", bus->replay->folder, number);
    bus->place = g_strdup(address.sun_path);
    bus->listens = listen_on((const struct sockaddr *)&address, sizeof address);
    return bus->listens >= 0;
}

static gboolean open_terminal(struct bus *bus, int number) {
    bus->place = g_strdup_printf("%s/port%d", bus->replay->folder, number);
    const gboolean greets = steps_greeting(bus->steps)->len > 0;
    const gboolean opened = terminal_open(&bus->terminal, bus->place, greets);
    bus->fd = bus->terminal.wire;
    return opened;
}

static gboolean bus_open(struct bus *bus, int number, GError **error) {
    const char *kind = bus->kind;
    gboolean opened = FALSE;
    if (strcmp(kind, "usb") == 0)
        return plug_usb(bus, number, error);
    if (strcmp(kind, "serial") == 0) {
        opened = open_terminal(bus, number);
    } else if (strcmp(kind, "udp") == 0) {
        opened = open_udp(bus, number);
    } else if (strcmp(kind, "program") == 0) {
        opened = open_socket(bus, number);
    } else if (strcmp(kind, "http") == 0) {
        bus->place = g_strdup(address_of(bus->replay->recorded, number));
        opened = open_tcp(bus, bus->place);
        bus->http_port = tcp_port(bus->listens);
    } else if (strcmp(kind, "modbus") == 0) {
        opened = open_tcp(bus, "127.0.0.1");
        bus->place = g_strdup_printf("tcp:127.0.0.1:%d", tcp_port(bus->listens));
    }
    if (!opened) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_FAILED, "%s: cannot make the device of @%d: %s",
                    bus->replay->recorded->path, number, g_strerror(errno));
        return FALSE;
    }
    bus->thread = g_thread_new("replay", run, bus);
    return TRUE;
}

static void bus_free(gpointer data) {
    struct bus *bus = data;
    if (bus->thread)
        g_thread_join(bus->thread);
    if (bus->usb)
        virtual_usb_free(bus->usb);
    if (bus->terminal.wire >= 0 || bus->terminal.slave >= 0)
        bus->fd = -1;
    terminal_close(&bus->terminal);
    if (bus->fd >= 0)
        close(bus->fd);
    if (bus->listens >= 0)
        close(bus->listens);
    if (bus->place && g_str_has_prefix(bus->place, bus->replay->folder))
        g_unlink(bus->place);
    steps_free(bus->steps);
    g_byte_array_unref(bus->input);
    g_free(bus->place);
    g_free(bus->usb_name);
    g_free(bus);
}

static gboolean add_bus(Replay *replay, int number, const char *kind, GError **error) {
    const struct replay_protocol *protocol = replay_protocol_find(kind, replay->recorded->sections);
    struct bus *bus = g_new0(struct bus, 1);
    *bus = (struct bus){.replay = replay,
                        .kind = kind,
                        .steps = protocol ? steps_new(replay->recorded, number, protocol) : NULL,
                        .terminal = TERMINAL_CLOSED,
                        .listens = -1,
                        .fd = -1,
                        .input = g_byte_array_new()};
    g_ptr_array_add(replay->buses, bus);
    return !protocol || bus_open(bus, number, error);
}

/* Returns the text that replaces "KEY = @N" in the sections. */
static char *placed(const Replay *replay, const char *key, const struct bus *bus) {
    if (strcmp(bus->kind, "program") == 0)
        return g_strdup_printf("%s = /usr/bin/python3\narguments = %s;%s", key, replay->pipe,
                               bus->place);
    GString *lines = g_string_new(NULL);
    g_string_append_printf(lines, "%s = %s", key, bus->place);
    if (strcmp(bus->kind, "udp") == 0 || strcmp(bus->kind, "http") == 0)
        g_string_append_printf(lines, "\nlocal_address = %s", virtual_dmx_address(COMPUTER));
    for (guint i = 0; i < replay->buses->len; i++) {
        const int port = ((const struct bus *)replay->buses->pdata[i])->http_port;
        if (port)
            g_string_append_printf(lines, "\nhttp_port = %d", port);
    }
    return g_string_free(lines, FALSE);
}

static char *place_sections(const Replay *replay) {
    g_auto(GStrv) lines = g_strsplit(replay->recorded->sections, "\n", -1);
    for (char **line = lines; *line; line++) {
        const char *at = strstr(*line, " = @");
        const guint64 number = at ? g_ascii_strtoull(at + 4, NULL, 10) : 0;
        const gboolean port = g_str_has_prefix(*line, "http_port = ");
        if (!port && (number < 1 || number > replay->buses->len ||
                      !((const struct bus *)replay->buses->pdata[number - 1])->place))
            continue;
        g_autofree char *key = at ? g_strndup(*line, (gsize)(at - *line)) : NULL;
        char *new = port ? g_strdup("") : placed(replay, key, replay->buses->pdata[number - 1]);
        g_free(*line);
        *line = new;
    }
    return g_strjoinv("\n", lines);
}

Replay *replay_new(const Recorded *recorded, const char *pipe, GError **error) {
    g_autoptr(Replay) replay = g_new0(struct Replay, 1);
    replay->recorded = recorded;
    replay->pipe = pipe;
    replay->buses = g_ptr_array_new_with_free_func(bus_free);
    replay->folder = g_dir_make_tmp("mesorig-replay-XXXXXX", error);
    if (!replay->folder)
        return NULL;
    for (guint i = 0; i < recorded->kinds->len; i++)
        if (!add_bus(replay, (int)i + 1, recorded->kinds->pdata[i], error))
            return NULL;
    replay->sections = place_sections(replay);
    return g_steal_pointer(&replay);
}

void replay_free(Replay *replay) {
    if (!replay)
        return;
    g_atomic_int_set(&replay->quits, 1);
    g_ptr_array_unref(replay->buses);
    if (replay->folder)
        g_rmdir(replay->folder);
    g_free(replay->folder);
    g_free(replay->sections);
    g_free(replay);
}

const char *replay_sections(const Replay *replay) {
    return replay->sections;
}

static struct steps *steps_of(const Replay *replay, guint i) {
    return ((const struct bus *)replay->buses->pdata[i])->steps;
}

gboolean replay_is_at(Replay *replay, int line) {
    gboolean is = TRUE;
    g_mutex_lock(&replay->mutex);
    for (guint i = 0; i < replay->buses->len; i++)
        is = is && (!steps_of(replay, i) || steps_are_at(steps_of(replay, i), line));
    g_mutex_unlock(&replay->mutex);
    return is;
}

char *replay_difference(Replay *replay) {
    char *ret = NULL;
    g_mutex_lock(&replay->mutex);
    for (guint i = 0; i < replay->buses->len && !ret; i++)
        ret = steps_of(replay, i) ? g_strdup(steps_difference(steps_of(replay, i))) : NULL;
    g_mutex_unlock(&replay->mutex);
    return ret;
}

char *replay_missing(Replay *replay) {
    char *ret = NULL;
    g_mutex_lock(&replay->mutex);
    for (guint i = 0; i < replay->buses->len && !ret; i++)
        ret = steps_of(replay, i) ? steps_missing(steps_of(replay, i)) : NULL;
    g_mutex_unlock(&replay->mutex);
    return ret;
}
