#include "steps.h"

#include <string.h>

#define SHOWN 80 /* bytes of a message in a text for people */

struct step {
    int line;
    GBytes *request, *key;
    char *stream;
    GPtrArray *answers; /* of GBytes: all messages up to the next request */
    gboolean stalls;
    struct step *before; /* the previous step of the same stream, or NULL */
    GBytes *seen;        /* the request as the program has sent it; NULL until then */
};

struct steps {
    const Recorded *recorded;
    const struct replay_protocol *protocol;
    GPtrArray *list; /* of struct step */
    GPtrArray *greeting;
    GHashTable *last; /* the last step of each stream that has come; the key is the stream */
    guint next;
    char *difference;
};

static void step_free(gpointer data) {
    struct step *step = data;
    g_bytes_unref(step->request);
    g_bytes_unref(step->key);
    g_clear_pointer(&step->seen, g_bytes_unref);
    g_ptr_array_unref(step->answers);
    g_free(step->stream);
    g_free(step);
}

static gboolean have_same_answers(const struct step *a, const struct step *b) {
    if (a->answers->len != b->answers->len || a->stalls != b->stalls)
        return FALSE;
    for (guint i = 0; i < a->answers->len; i++)
        if (!g_bytes_equal(a->answers->pdata[i], b->answers->pdata[i]))
            return FALSE;
    return TRUE;
}

static GBytes *adapted(const struct steps *steps, GBytes *message, const guint8 *request, gsize n) {
    return g_bytes_get_size(message) > 0 ? steps->protocol->adapt(message, request, n)
                                         : g_bytes_ref(message);
}

/* Returns whether two steps have the same answers, apart from the numbers of the requests in
 * them. */
static gboolean say_the_same(const struct steps *steps, const struct step *a,
                             const struct step *b) {
    if (!steps->protocol->adapt)
        return have_same_answers(a, b);
    if (a->answers->len != b->answers->len)
        return FALSE;
    gsize n;
    const guint8 *request = g_bytes_get_data(a->request, &n);
    for (guint i = 0; i < a->answers->len; i++) {
        g_autoptr(GBytes) x = adapted(steps, a->answers->pdata[i], request, n);
        g_autoptr(GBytes) y = adapted(steps, b->answers->pdata[i], request, n);
        if (!g_bytes_equal(x, y))
            return FALSE;
    }
    return TRUE;
}

static gboolean is_no_news(const struct steps *steps, const struct step *step) {
    return *step->stream && step->before && g_bytes_equal(step->key, step->before->key) &&
           say_the_same(steps, step, step->before);
}

static void add_request(struct steps *steps, int line, const guint8 *bytes, gsize n,
                        GHashTable *streams) {
    gsize size;
    GBytes *key = n > 0 ? steps->protocol->key(bytes, n) : NULL;
    if (!key)
        return;
    const guint8 *data = g_bytes_get_data(key, &size);
    struct step *step = g_new0(struct step, 1);
    *step = (struct step){.line = line,
                          .request = g_bytes_new(bytes, n),
                          .key = key,
                          .stream = steps->protocol->stream(data, size, steps->recorded->sections),
                          .answers = g_ptr_array_new_with_free_func((GDestroyNotify)g_bytes_unref)};
    step->before = g_hash_table_lookup(streams, step->stream);
    g_hash_table_insert(streams, step->stream, step);
    g_ptr_array_add(steps->list, step);
}

/* Adds the requests of a line of the recording. A line is what the driver has written at once. It
 * may contain several requests. */
static void add_line(struct steps *steps, const struct recorded_line *line, GHashTable *streams) {
    gsize n, length;
    const guint8 *bytes = g_bytes_get_data(line->bytes, &n);
    if (!steps->protocol->cut) {
        add_request(steps, line->number, bytes, n, streams);
        return;
    }
    while (n > 0 && (length = steps->protocol->cut((const char *)bytes, n)) > 0) {
        add_request(steps, line->number, bytes, length, streams);
        bytes += length;
        n -= length;
    }
}

static gboolean is_stall(GBytes *note) {
    return g_bytes_get_size(note) == 5 && memcmp(g_bytes_get_data(note, NULL), "stall", 5) == 0;
}

struct steps *steps_new(const Recorded *recorded, int bus, const struct replay_protocol *protocol) {
    struct steps *steps = g_new0(struct steps, 1);
    g_autoptr(GHashTable) streams = g_hash_table_new(g_str_hash, g_str_equal);
    *steps = (struct steps){.recorded = recorded,
                            .protocol = protocol,
                            .list = g_ptr_array_new_with_free_func(step_free),
                            .greeting = g_ptr_array_new(),
                            .last = g_hash_table_new(g_str_hash, g_str_equal)};
    for (guint i = 0; i < recorded->lines->len; i++) {
        const struct recorded_line *line = recorded->lines->pdata[i];
        struct step *last = steps->list->len ? steps->list->pdata[steps->list->len - 1] : NULL;
        if (line->bus != bus)
            continue;
        if (line->way == '>')
            add_line(steps, line, streams);
        else if (line->way == '<' && last)
            g_ptr_array_add(last->answers, g_bytes_ref(line->bytes));
        else if (line->way == '<')
            g_ptr_array_add(steps->greeting, line->bytes);
        else if (last)
            last->stalls |= is_stall(line->bytes);
    }
    return steps;
}

void steps_free(struct steps *steps) {
    if (!steps)
        return;
    g_ptr_array_unref(steps->list);
    g_ptr_array_unref(steps->greeting);
    g_hash_table_unref(steps->last);
    g_free(steps->difference);
    g_free(steps);
}

const GPtrArray *steps_greeting(const struct steps *steps) {
    return steps->greeting;
}

/* Returns a message as a text of at most SHOWN bytes. */
static char *shown(const guint8 *bytes, gsize n) {
    gboolean text = TRUE;
    GString *to = g_string_new(NULL);
    for (gsize i = 0; i < n; i++)
        text &= (bytes[i] >= 0x20 && bytes[i] < 0x7f) || bytes[i] == '\n' || bytes[i] == '\r';
    for (gsize i = 0; i < MIN(n, SHOWN); i++)
        g_string_append_printf(to,
                               text ? "%c"
                               : i  ? " %02x"
                                    : "%02x",
                               bytes[i] < 0x20 && text ? ' ' : bytes[i]);
    g_strstrip(to->str);
    to->len = strlen(to->str);
    if (n > SHOWN)
        g_string_append(to, " …");
    return g_string_free(to, FALSE);
}

/* Returns the next step whose request must come, or NULL. Repetitions without a new answer need not
 * come. */
static const struct step *next_news(const struct steps *steps) {
    for (guint i = steps->next; i < steps->list->len; i++)
        if (!is_no_news(steps, steps->list->pdata[i]))
            return steps->list->pdata[i];
    return NULL;
}

static void differ(struct steps *steps, const guint8 *bytes, gsize n) {
    g_autofree char *seen = shown(bytes, n);
    const struct step *step = next_news(steps);
    if (!step) {
        steps->difference = g_strdup_printf(
            "%s: the recording has ended, but the program sent “%s”", steps->recorded->path, seen);
        return;
    }
    gsize size;
    const guint8 *request = g_bytes_get_data(step->request, &size);
    g_autofree char *expected = shown(request, size);
    gsize same = 0;
    while (same < MIN(n, size) && bytes[same] == request[same])
        same++;
    steps->difference = g_strdup_printf("%s:%d: expected “%s”, but the program sent “%s” (they "
                                        "differ from byte %zu on)",
                                        steps->recorded->path, step->line, expected, seen, same);
}

/* Returns a message with the number that its request has in this run. */
static GBytes *numbered(const struct steps *steps, GBytes *message) {
    const struct replay_protocol *protocol = steps->protocol;
    gsize length;
    const guint8 *data = g_bytes_get_data(message, &length);
    for (guint i = steps->next; i-- > 0 && protocol->adapt && protocol->answers && length > 0;) {
        const struct step *step = steps->list->pdata[i];
        gsize size, n;
        const guint8 *request = g_bytes_get_data(step->request, &size);
        if (!step->seen || !protocol->answers(request, size, data, length))
            continue;
        const guint8 *seen = g_bytes_get_data(step->seen, &n);
        return protocol->adapt(message, seen, n);
    }
    return g_bytes_ref(message);
}

/* Appends the answers of a step. If only_own is TRUE, messages that the device has sent by itself
 * are left out. */
static enum steps_result answer(struct steps *steps, struct step *step, const guint8 *bytes,
                                gsize n, gboolean only_own, GPtrArray *ret) {
    const struct replay_protocol *protocol = steps->protocol;
    gsize size, length;
    const guint8 *request = g_bytes_get_data(step->request, &size);
    g_clear_pointer(&step->seen, g_bytes_unref);
    step->seen = g_bytes_new(bytes, n);
    for (guint i = 0; i < step->answers->len; i++) {
        GBytes *message = step->answers->pdata[i];
        const guint8 *data = g_bytes_get_data(message, &length);
        const gboolean own =
            !protocol->answers || (length > 0 && protocol->answers(request, size, data, length));
        if (only_own && !own)
            continue;
        g_ptr_array_add(ret, numbered(steps, message));
    }
    return step->stalls ? STEPS_STALLED : STEPS_ANSWERED;
}

/* Returns the next step with this key, or NULL. Only repetitions without a new answer are passed
 * over. */
static struct step *find(struct steps *steps, GBytes *key) {
    for (guint i = steps->next; i < steps->list->len; i++) {
        struct step *step = steps->list->pdata[i];
        if (g_bytes_equal(step->key, key)) {
            steps->next = i + 1;
            return step;
        }
        if (!is_no_news(steps, step))
            return NULL;
    }
    return NULL;
}

enum steps_result steps_take(struct steps *steps, const guint8 *bytes, gsize n, GPtrArray *ret) {
    gsize size;
    if (steps->difference)
        return STEPS_DIFFERS;
    g_autoptr(GBytes) key = n > 0 ? steps->protocol->key(bytes, n) : NULL;
    if (!key)
        return STEPS_ANSWERED;
    const guint8 *data = g_bytes_get_data(key, &size);
    g_autofree char *stream = steps->protocol->stream(data, size, steps->recorded->sections);
    struct step *step = find(steps, key);
    if (step) {
        g_hash_table_insert(steps->last, step->stream, step);
        return answer(steps, step, bytes, n, FALSE, ret);
    }
    struct step *last = g_hash_table_lookup(steps->last, stream);
    if (*stream && last && g_bytes_equal(last->key, key))
        return answer(steps, last, bytes, n, TRUE, ret);
    differ(steps, bytes, n);
    return STEPS_DIFFERS;
}

gboolean steps_are_at(const struct steps *steps, int line) {
    const struct step *step = next_news(steps);
    return !step || step->line >= line;
}

const char *steps_difference(const struct steps *steps) {
    return steps->difference;
}

char *steps_missing(const struct steps *steps) {
    const struct step *step = next_news(steps);
    gsize n;
    if (!step)
        return NULL;
    const guint8 *bytes = g_bytes_get_data(step->request, &n);
    g_autofree char *expected = shown(bytes, n);
    return g_strdup_printf("%s:%d: expected “%s”, but nothing came", steps->recorded->path,
                           step->line, expected);
}
