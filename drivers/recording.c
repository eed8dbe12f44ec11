#include "recording.h"

#include "base/output_file.h"

#include <string.h>
#include <sys/utsname.h>

#define MAX_SIZE (32 << 20) /* maximum number of bytes of the messages */
/* from this number on, equal bytes 00 or ff are written as one byte with their number */
#define MIN_RUN   8
#define MIN_HIDE  4
#define MIN_BYTES 3

struct bus {
    char *kind, *address;
    GString *line; /* the received part of a line that is not complete yet */
};

struct hidden {
    char *text, *instead;
    gboolean is_hex; /* the text consists of the hexadecimal digits of hidden bytes */
};

static struct {
    GMutex mutex;
    gint64 begun_us;
    GString *sections, *lines;
    GPtrArray *buses;  /* of struct bus; bus @1 is the first */
    GPtrArray *hidden; /* of struct hidden, in the order in which they are replaced */
    gboolean full;
} recording;

gint recording_state;

static void bus_free(gpointer data) {
    struct bus *bus = data;
    g_string_free(bus->line, TRUE);
    g_free(bus->kind);
    g_free(bus->address);
    g_free(bus);
}

static void hidden_free(gpointer data) {
    struct hidden *hidden = data;
    g_free(hidden->text);
    g_free(hidden->instead);
    g_free(hidden);
}

static void clear(void) {
    g_atomic_int_set(&recording_state, 0);
    if (!recording.lines)
        return;
    g_string_free(g_steal_pointer(&recording.lines), TRUE);
    g_string_free(g_steal_pointer(&recording.sections), TRUE);
    g_clear_pointer(&recording.buses, g_ptr_array_unref);
    g_clear_pointer(&recording.hidden, g_ptr_array_unref);
}

void recording_begin(void) {
    g_mutex_lock(&recording.mutex);
    clear();
    recording.begun_us = g_get_monotonic_time();
    recording.lines = g_string_new(NULL);
    recording.sections = g_string_new(NULL);
    recording.buses = g_ptr_array_new_with_free_func(bus_free);
    recording.hidden = g_ptr_array_new_with_free_func(hidden_free);
    recording.full = FALSE;
    g_atomic_int_set(&recording_state, 1);
    g_mutex_unlock(&recording.mutex);
}

/* Locks the recording. Returns FALSE, and does not lock it, if there is none or if it is full. */
static gboolean take(void) {
    g_mutex_lock(&recording.mutex);
    if (recording.lines && recording.lines->len < MAX_SIZE)
        return TRUE;
    recording.full |= recording.lines != NULL;
    g_mutex_unlock(&recording.mutex);
    return FALSE;
}

static void leave(void) {
    g_mutex_unlock(&recording.mutex);
}

/* Adds a text in quotation marks. Characters that are not printable ASCII are escaped. */
static void add_quoted(const char *text, gsize n) {
    GString *to = recording.lines;
    g_string_append_c(to, '"');
    for (gsize i = 0; i < n; i++) {
        const guint8 c = (guint8)text[i];
        if (c == '"' || c == '\\')
            g_string_append_printf(to, "\\%c", c);
        else if (c == '\n' || c == '\r' || c == '\t')
            g_string_append_printf(to, "\\%c", c == '\n' ? 'n' : c == '\r' ? 'r' : 't');
        else if (c < 0x20 || c >= 0x7f)
            g_string_append_printf(to, "\\x%02x", c);
        else
            g_string_append_c(to, (char)c);
    }
    g_string_append_c(to, '"');
}

static void add_hex(const guint8 *bytes, gsize n) {
    gsize run;
    for (gsize i = 0; i < n; i += run) {
        for (run = 1; i + run < n && bytes[i + run] == bytes[i];)
            run++;
        /* Only runs of 00 and of ff are shortened. A run of another byte may be part of a text that
         * recording_hide() replaces later, and a shortened text would not be found. */
        if (run < MIN_RUN || (bytes[i] != 0 && bytes[i] != 0xff))
            run = 1;
        g_string_append_printf(recording.lines, "%s%02x", i ? " " : "", bytes[i]);
        if (run > 1)
            g_string_append_printf(recording.lines, "*%zu", run);
    }
}

/* Returns the index of a bus, or the number of buses if it is new. */
static guint index_of(struct recording_bus wanted) {
    guint i = 0;
    for (; i < recording.buses->len; i++) {
        const struct bus *bus = recording.buses->pdata[i];
        if (strcmp(bus->kind, wanted.kind) == 0 && strcmp(bus->address, wanted.address) == 0)
            break;
    }
    return i;
}

static gboolean is_known(struct recording_bus bus) {
    return index_of(bus) < recording.buses->len;
}

/* Returns a bus, and adds it if it is new. */
static struct bus *find_bus(struct recording_bus wanted, guint *ret_number) {
    const guint i = index_of(wanted);
    if (i == recording.buses->len) {
        struct bus *bus = g_new0(struct bus, 1);
        *bus = (struct bus){g_strdup(wanted.kind), g_strdup(wanted.address), g_string_new(NULL)};
        g_ptr_array_add(recording.buses, bus);
    }
    *ret_number = i + 1;
    return recording.buses->pdata[i];
}

static void add_time(void) {
    g_string_append_printf(recording.lines, "%10" G_GINT64_FORMAT " ",
                           g_get_monotonic_time() - recording.begun_us);
}

static void add_bus(guint number, char way) {
    add_time();
    g_string_append_printf(recording.lines, "@%u %c ", number, way);
}

static void add_text(guint number, enum recording_way way, const char *text, gsize n) {
    add_bus(number, way == RECORDING_SENT ? '>' : '<');
    add_quoted(text, n);
    g_string_append_c(recording.lines, '\n');
}

void recording_text(struct recording_bus bus, enum recording_way way, const char *bytes, gsize n) {
    guint number;
    if (!recording_is_on() || !take())
        return;
    struct bus *on = find_bus(bus, &number);
    if (way == RECORDING_SENT) {
        add_text(number, way, bytes, n);
    } else {
        const char *end;
        g_string_append_len(on->line, bytes, (gssize)n);
        while ((end = memchr(on->line->str, '\n', on->line->len))) {
            const gsize length = (gsize)(end - on->line->str) + 1;
            add_text(number, way, on->line->str, length);
            g_string_erase(on->line, 0, (gssize)length);
        }
    }
    leave();
}

void recording_bytes(struct recording_bus bus, enum recording_way way, const guint8 *bytes,
                     gsize n) {
    guint number;
    if (!recording_is_on() || !take())
        return;
    /* Packets from unknown addresses are not recorded, because they may come from devices of other
     * people. */
    if (way == RECORDING_SENT || strcmp(bus.kind, "udp") != 0 || is_known(bus)) {
        find_bus(bus, &number);
        add_bus(number, way == RECORDING_SENT ? '>' : '<');
        add_hex(bytes, n);
        g_string_append_c(recording.lines, '\n');
    }
    leave();
}

void recording_note(struct recording_bus bus, const char *format, ...) {
    guint number;
    va_list args;
    if (!recording_is_on() || !take())
        return;
    va_start(args, format);
    g_autofree char *text = g_strdup_vprintf(format, args);
    va_end(args);
    find_bus(bus, &number);
    add_bus(number, '-');
    add_quoted(text, strlen(text));
    g_string_append_c(recording.lines, '\n');
    leave();
}

void recording_device(const char *who, const char *format, ...) {
    va_list args;
    if (!recording_is_on() || !take())
        return;
    va_start(args, format);
    g_autofree char *text = g_strdup_vprintf(format, args);
    va_end(args);
    g_strdelimit(text, "\r\n", ' ');
    add_time();
    g_string_append_printf(recording.lines, "[%s] %s\n", who, text);
    leave();
}

gboolean recording_is_place(const char *key) {
    static const char *const keys[] = {"address", "arguments",     "bus",    "device", "folder",
                                       "host",    "local_address", "path",   "port",   "program",
                                       "serial",  "pulse_path",    "source", NULL};
    return g_strv_contains(keys, key);
}

void recording_section(const struct config_section *section) {
    if (!recording_is_on() || !take())
        return;
    GString *to = recording.sections;
    g_string_append_printf(to, "\n[%s]\n", section->group);
    for (const char *const *key = config_keys(section); *key; key++) {
        const char *value = config_value(section, *key, NULL);
        /* The mark \001 is replaced in recording_end(), when the number of the bus is known. */
        if (recording_is_place(*key))
            g_string_append_printf(to, "%s = \001%s\n", *key, value);
        else
            g_string_append_printf(to, "%s = %s\n", *key, value);
    }
    leave();
}

static void hide(const char *text, const char *instead) {
    if (!text || strlen(text) < MIN_HIDE)
        return;
    for (guint i = 0; i < recording.hidden->len; i++)
        if (strcmp(((struct hidden *)recording.hidden->pdata[i])->text, text) == 0)
            return;
    struct hidden *hidden = g_new0(struct hidden, 1);
    hidden->text = g_strdup(text);
    hidden->instead = instead ? g_strdup(instead) : g_strnfill(strlen(text), 'X');
    g_ptr_array_add(recording.hidden, hidden);
}

/* Returns bytes in hexadecimal digits. If wide is TRUE, a byte of 0 follows each of them, as in
 * UTF-16. */
static char *hex_of(const guint8 *bytes, gsize n, gboolean wide) {
    GString *to = g_string_new(NULL);
    for (gsize i = 0; i < n; i++)
        g_string_append_printf(to, "%s%02x%s", i ? " " : "", bytes[i], wide ? " 00" : "");
    return g_string_free(to, FALSE);
}

void recording_hide(const char *text, const char *instead) {
    if (!recording_is_on() || !take())
        return;
    hide(text, instead);
    leave();
}

void recording_hide_bytes(const guint8 *bytes, gsize n) {
    static const guint8 zeros[64] = {0};
    g_return_if_fail(n <= sizeof zeros);
    /* Leave out zeros at both ends, because add_hex() may have joined them with other zeros. */
    for (; n > 0 && bytes[0] == 0; n--)
        bytes++;
    while (n > 0 && bytes[n - 1] == 0)
        n--;
    if (!recording_is_on() || n < MIN_BYTES || !take())
        return;
    g_autofree char *from = hex_of(bytes, n, FALSE), *to = hex_of(zeros, n, FALSE);
    hide(from, to);
    struct hidden *last = recording.hidden->pdata[recording.hidden->len - 1];
    last->is_hex |= strcmp(last->text, from) == 0;
    leave();
}

/* Returns whether the name of a device contains this text. Names come from the rig file, and the
 * recording shows them everywhere. */
static gboolean is_in_name(const char *text) {
    g_auto(GStrv) lines = g_strsplit(recording.sections->str, "\n", -1);
    gboolean is = FALSE;
    for (char **line = lines; *line; line++)
        is |= **line == '[' && strstr(*line, text);
    return is;
}

static void replace(GString *in, const struct hidden *hidden) {
    const gsize n = strlen(hidden->text);
    g_string_replace(in, hidden->text, hidden->instead, 0);
    if (hidden->is_hex || n != strlen(hidden->instead))
        return; /* a binary message keeps its length */
    for (int wide = 0; wide < 2; wide++) {
        g_autofree char *from = hex_of((const guint8 *)hidden->text, n, wide);
        g_autofree char *to = hex_of((const guint8 *)hidden->instead, n, wide);
        g_string_replace(in, from, to, 0);
    }
}

/* Replaces the value of each key that names a place by the number of the bus, or leaves the value
 * out. Also hides these values in the messages. */
static char *places_numbered(void) {
    g_auto(GStrv) lines = g_strsplit(recording.sections->str, "\n", -1);
    for (char **line = lines; *line; line++) {
        char *mark = strchr(*line, '\001');
        if (!mark)
            continue;
        guint number = 0;
        hide(mark + 1, NULL);
        for (guint i = 0; i < recording.buses->len && !number; i++)
            if (strcmp(((struct bus *)recording.buses->pdata[i])->address, mark + 1) == 0)
                number = i + 1;
        char *new = number ? g_strdup_printf("%.*s@%u", (int)(mark - *line), *line, number)
                           : g_strdup_printf("# %.*sleft out", (int)(mark - *line), *line);
        g_free(*line);
        *line = new;
    }
    return g_strjoinv("\n", lines);
}

static GString *header(void) {
    GString *to = g_string_new(NULL);
    struct utsname system = {0};
    g_autoptr(GDateTime) now = g_date_time_new_now_utc();
    g_autofree char *date = g_date_time_format(now, "%Y-%m-%d");
    uname(&system);
    g_string_append_printf(to, "mesorig-recording %d\n", RECORDING_VERSION);
    g_string_append(to, "# " OUTPUT_FILE_TEXT("recording") "\n");
    g_string_append_printf(to, "program = mesorig %s\ndate = %s\nkernel = %s %s %s\n",
                           MESORIG_VERSION, date, system.sysname, system.release, system.machine);
    g_string_append_printf(to, "made from = %s\n",
                           recording.buses->len > 0 ? "a device"
                                                    : "simulated devices, without a bus");
    for (guint i = 0; i < recording.buses->len; i++)
        g_string_append_printf(to, "@%u = %s\n", i + 1,
                               ((struct bus *)recording.buses->pdata[i])->kind);
    return to;
}

/* Hides the addresses of buses before anything else. */
static void hide_buses(void) {
    g_autoptr(GPtrArray) others = g_steal_pointer(&recording.hidden);
    recording.hidden = g_ptr_array_new_with_free_func(hidden_free);
    for (guint i = 0; i < recording.buses->len; i++) {
        g_autofree char *number = g_strdup_printf("@%u", i + 1);
        hide(((struct bus *)recording.buses->pdata[i])->address, number);
    }
    g_ptr_array_extend_and_steal(recording.hidden, g_steal_pointer(&others));
}

char *recording_end(void) {
    g_mutex_lock(&recording.mutex);
    if (!recording.lines) {
        g_mutex_unlock(&recording.mutex);
        return NULL;
    }
    g_atomic_int_set(&recording_state, 0);
    for (guint i = 0; i < recording.buses->len; i++) {
        const struct bus *bus = recording.buses->pdata[i];
        if (bus->line->len > 0)
            add_text(i + 1, RECORDING_RECEIVED, bus->line->str, bus->line->len);
    }
    hide_buses();
    g_autoptr(GString) text = header();
    g_autofree char *sections = places_numbered();
    g_string_append_printf(text, "%s\n%s", sections, recording.lines->str);
    if (recording.full)
        g_string_append_printf(text, "# It is cut off here, at %d MiB.\n", MAX_SIZE >> 20);
    hide(g_get_home_dir(), "{home}");
    hide(g_get_host_name(), NULL);
    for (guint i = 0; i < recording.hidden->len; i++)
        if (!is_in_name(((struct hidden *)recording.hidden->pdata[i])->text))
            replace(text, recording.hidden->pdata[i]);
    clear();
    g_mutex_unlock(&recording.mutex);
    return g_string_free(g_steal_pointer(&text), FALSE);
}
