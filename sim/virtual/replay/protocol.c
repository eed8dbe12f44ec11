#include "protocol.h"

#include "serial/lamp_line.h"

#include <stdlib.h>
#include <string.h>

static GBytes *same(const guint8 *bytes, gsize n) {
    return g_bytes_new(bytes, n);
}

static char *hex(const guint8 *bytes, gsize n) {
    GString *to = g_string_new(NULL);
    for (gsize i = 0; i < n; i++)
        g_string_append_printf(to, "%02x", bytes[i]);
    return g_string_free(to, FALSE);
}

/* Protocols that consist of lines. An empty line is ignored, because its only purpose is to end
 * noise. */
static gsize cut_line(const char *bytes, gsize n) {
    const char *end = memchr(bytes, '\n', n);
    return end ? (gsize)(end - bytes) + 1 : 0;
}

static GBytes *trimmed(char *line) {
    g_strstrip(line);
    GBytes *ret = *line ? g_bytes_new(line, strlen(line)) : NULL;
    g_free(line);
    return ret;
}

static GBytes *key_line(const guint8 *bytes, gsize n) {
    return trimmed(g_strndup((const char *)bytes, n));
}

/* GRBL 1.1: single characters act at once. */
static gsize cut_grbl(const char *bytes, gsize n) {
    return strchr("?!~\x18\x84", *bytes) && *bytes ? 1 : cut_line(bytes, n);
}

static char *stream_grbl(const guint8 *key, gsize n, const char *sections) {
    return g_strdup(n == 1 && *key == '?' ? "?" : "");
}

static gboolean answers_grbl(const guint8 *request, gsize n, const guint8 *message, gsize size) {
    return (n == 1 && *request == '?') == (size > 0 && *message == '<');
}

/* Marlin: a request is such as "N12 M114*37", with a number and a checksum. */
static GBytes *key_marlin(const guint8 *bytes, gsize n) {
    char *line = g_strndup((const char *)bytes, n);
    char *sum = strrchr(line, '*');
    if (sum)
        *sum = 0;
    g_strstrip(line);
    if (*line == 'N' && g_ascii_isdigit(line[1])) {
        const char *rest = strchr(line, ' ');
        memmove(line, rest ? rest + 1 : "", rest ? strlen(rest) : 1);
    }
    return trimmed(line);
}

static char *stream_marlin(const guint8 *key, gsize n, const char *sections) {
    return g_strdup(n == 4 && memcmp(key, "M114", 4) == 0 ? "M114" : "");
}

/* The LED controller: a request is such as "L1 002a s 03 ff*91de". Its number is at NUMBER_AT. */
#define NUMBER_AT 3
#define REST_AT   7

static GBytes *key_leds(const guint8 *bytes, gsize n) {
    char *line = g_strstrip(g_strndup((const char *)bytes, n));
    char *sum = strrchr(line, '*');
    if (sum)
        *sum = 0;
    if (strlen(line) > REST_AT)
        memmove(line + NUMBER_AT, line + REST_AT, strlen(line + REST_AT) + 1);
    return trimmed(line);
}

static char *stream_leds(const guint8 *key, gsize n, const char *sections) {
    return g_strdup(n > 0 && key[n - 1] == 'p' ? "p" : "");
}

static const char *number_of_line(const guint8 *bytes, gsize n) {
    gsize skip = 0;
    while (skip < n && (bytes[skip] == '\n' || bytes[skip] == '\r'))
        skip++;
    return n >= skip + REST_AT ? (const char *)bytes + skip + NUMBER_AT : NULL;
}

static gboolean answers_leds(const guint8 *request, gsize n, const guint8 *message, gsize size) {
    const char *a = number_of_line(request, n), *b = number_of_line(message, size);
    return a && b && memcmp(a, b, 4) == 0;
}

static GBytes *adapt_leds(GBytes *message, const guint8 *request, gsize n) {
    gsize size;
    const char *bytes = g_bytes_get_data(message, &size), *number = number_of_line(request, n);
    g_autofree char *line = g_strstrip(g_strndup(bytes, size));
    char *sum = strrchr(line, '*');
    if (!number || !sum || strlen(line) < REST_AT || memcmp(line + NUMBER_AT, "0000", 4) == 0)
        return g_bytes_ref(message);
    memcpy(line + NUMBER_AT, number, 4);
    *sum = 0;
    char *whole = g_strdup_printf("%s*%04x\n", line, lamp_line_crc(line, strlen(line)));
    return g_bytes_new_take(whole, strlen(whole));
}

/* Modbus: a request has a unit, a function and data. Functions below FIRST_WRITE only read. */
#define FIRST_WRITE 5

/* Returns whether a key of the sections contains the address as one of its numbers. For example,
 * "watchdog = 5=1;7=0" contains 5 and 7, and "watchdog_register = 6" contains 6. */
static gboolean has_address(const char *sections, const char *key, gulong address) {
    g_autofree char *mark = g_strdup_printf("\n%s = ", key);
    for (const char *at = sections; (at = strstr(at, mark));) {
        g_autofree char *line = g_strndup(at + strlen(mark), strcspn(at + strlen(mark), "\n"));
        g_auto(GStrv) parts = g_strsplit(line, ";", -1);
        for (char **part = parts; *part; part++)
            if (strtoul(*part, NULL, 0) == address)
                return TRUE;
        at += strlen(mark);
    }
    return FALSE;
}

/* Writes to a watchdog are repeated again and again, so each address of a watchdog has its own
 * stream. */
static char *stream_modbus(const guint8 *key, gsize n, const char *sections) {
    const gulong address = n > 3 ? (gulong)(key[2] << 8 | key[3]) : 0;
    if (n > 3 && key[1] < FIRST_WRITE)
        return hex(key, n);
    if (has_address(sections, "watchdog", address) ||
        has_address(sections, "pulse_coil", address) ||
        has_address(sections, "watchdog_register", address))
        return g_strdup_printf("watchdog %d %lu", key[0], address);
    return g_strdup("");
}

/* DMX512 by UDP. The levels of each universe are a stream of their own. */
static gboolean is_sacn(const guint8 *bytes, gsize n) {
    return n == 638 && memcmp(bytes + 4, "ASC-E1.17", 9) == 0;
}

static GBytes *key_udp(const guint8 *bytes, gsize n) {
    g_autofree guint8 *copy = g_memdup2(bytes, n);
    if (is_sacn(bytes, n)) {
        memset(copy + 22, 0, 16); /* CID, which names the computer */
        copy[111] = 0;            /* sequence number */
    }
    return g_bytes_new(copy, n);
}

static char *stream_udp(const guint8 *key, gsize n, const char *sections) {
    if (is_sacn(key, n))
        return g_strdup_printf("sACN %d", key[113] << 8 | key[114]);
    if (n > 18 && memcmp(key, "Art-Net", 8) == 0)
        return g_strdup_printf("Art-Net %d", key[14] | key[15] << 8);
    return n > 4 && key[0] == 4 ? g_strdup_printf("WLED %d", key[2] << 8 | key[3]) : hex(key, n);
}

/* WLED: a request by HTTP asks for a state, or sets the state that the driver confirms. The driver
 * repeats a request until the answer is recent enough, so all these requests are in one stream. */
static char *stream_http(const guint8 *key, gsize n, const char *sections) {
    return g_strdup("HTTP");
}

/* Programs: each line is a request in JSON-RPC. */
static const char *find(const guint8 *bytes, gsize n, const char *name) {
    const char *at = g_strstr_len((const char *)bytes, (gssize)n, name);
    return at ? at + strlen(name) : NULL;
}

static gint64 id_of(const guint8 *bytes, gsize n) {
    const char *at = find(bytes, n, "\"id\":");
    return at ? g_ascii_strtoll(at, NULL, 10) : -1;
}

static GBytes *with_id(const guint8 *bytes, gsize n, gint64 id) {
    const char *at = find(bytes, n, "\"id\":");
    if (!at)
        return g_bytes_new(bytes, n);
    const char *rest = at;
    while (*rest == ' ' || g_ascii_isdigit(*rest))
        rest++;
    const gsize head = (gsize)(at - (const char *)bytes),
                tail = n - (gsize)(rest - (const char *)bytes);
    char *text = g_strdup_printf("%.*s%" G_GINT64_FORMAT "%.*s", (int)head, (const char *)bytes, id,
                                 (int)tail, rest);
    return g_bytes_new_take(text, strlen(text));
}

static GBytes *key_program(const guint8 *bytes, gsize n) {
    g_autofree char *line = g_strndup((const char *)bytes, n);
    g_strstrip(line);
    return with_id((const guint8 *)line, strlen(line), 0);
}

static char *stream_program(const guint8 *key, gsize n, const char *sections) {
    return g_strdup(find(key, n, "\"method\":\"ping\"")  ? "ping"
                    : find(key, n, "\"method\":\"get\"") ? "get"
                                                         : "");
}

static gboolean answers_program(const guint8 *request, gsize n, const guint8 *message, gsize size) {
    return id_of(request, n) == id_of(message, size);
}

static GBytes *adapt_program(GBytes *message, const guint8 *request, gsize n) {
    gsize size;
    const guint8 *bytes = g_bytes_get_data(message, &size);
    return id_of(bytes, size) > 0 ? with_id(bytes, size, id_of(request, n)) : g_bytes_ref(message);
}

/* USB: a control request is a setup packet, and data. Requests for descriptors are ignored, because
 * the model of the bus answers them itself. The Tic's "reset command timeout" (0x8c) is repeated
 * again and again. */
#define GET_DESCRIPTOR 6

static GBytes *key_usb(const guint8 *bytes, gsize n) {
    const gboolean descriptor = n >= 8 && bytes[0] == 0x80 && bytes[1] == GET_DESCRIPTOR;
    return descriptor ? NULL : g_bytes_new(bytes, n);
}

static char *stream_usb(const guint8 *key, gsize n, const char *sections) {
    return n >= 8 && (key[0] & 0x80 || (key[0] == 0x40 && key[1] == 0x8c)) ? hex(key, n)
                                                                           : g_strdup("");
}

static const char *const grbl[] = {"driver = gcode-axis", NULL};
static const char *const marlin[] = {"dialect = marlin", NULL};
static const char *const leds[] = {"driver = serial-lamps", NULL};

/* The first protocol that fits is used. */
static const struct replay_protocol protocols[] = {
    {"serial", marlin, cut_line, key_marlin, stream_marlin, NULL, NULL},
    {"serial", grbl, cut_grbl, key_line, stream_grbl, answers_grbl, NULL},
    {"serial", leds, cut_line, key_leds, stream_leds, answers_leds, adapt_leds},
    {"modbus", NULL, NULL, same, stream_modbus, NULL, NULL},
    {"udp", NULL, NULL, key_udp, stream_udp, NULL, NULL},
    {"http", NULL, NULL, key_line, stream_http, NULL, NULL},
    {"program", NULL, cut_line, key_program, stream_program, answers_program, adapt_program},
    {"usb", NULL, NULL, key_usb, stream_usb, NULL, NULL},
};

const struct replay_protocol *replay_protocol_find(const char *kind, const char *sections) {
    for (gsize i = 0; i < G_N_ELEMENTS(protocols); i++) {
        const struct replay_protocol *protocol = &protocols[i];
        gboolean fits = protocol->words == NULL;
        for (int k = 0; protocol->words && protocol->words[k]; k++)
            fits |= strstr(sections, protocol->words[k]) != NULL;
        if (fits && strcmp(protocol->kind, kind) == 0)
            return protocol;
    }
    return NULL;
}
