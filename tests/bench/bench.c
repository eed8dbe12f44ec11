#include "bench.h"
#include "base/robust.h"

#include "base/json.h"

#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define DEEPEST 8
#define WIDEST  132 /* characters of a row of a table */
#define NAME    22  /* of the column of the rows' names */
#define KEY     35  /* where each value has a line */
#define TEXT    10  /* of other columns, at least */
#define NUMBER  8

static gboolean json;

void bench_parse(int *argc, char ***argv, const GOptionEntry *entries, const char *arguments) {
    const GOptionEntry own[] = {
        {"json", 0, 0, G_OPTION_ARG_NONE, &json, "Print JSON instead of tables", NULL}, {NULL}};
    g_autoptr(GOptionContext) context = g_option_context_new(arguments);
    GError *error = NULL;
    setlocale(LC_CTYPE, "");
    if (entries)
        g_option_context_add_main_entries(context, entries, NULL);
    g_option_context_add_main_entries(context, own, NULL);
    if (!g_option_context_parse(context, argc, argv, &error))
        bench_fail(2, "%s", error->message);
}

void bench_fail(int status, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    g_autofree char *message = g_strdup_vprintf(format, arguments);
    va_end(arguments);
    fprintf(stderr, "%s: %s\n", g_get_prgname(), message);
    exit(status);
}

void bench_check(const GError *error) {
    if (error)
        bench_fail(1, "%s", error->message);
}

/* An object or a list that is open. */
struct level {
    char *key; /* or NULL */
    gboolean list;
    gboolean filled; /* JSON: something is in it. Text: its key or its first values are printed. */
};

static struct level levels[DEEPEST];
static int depth;
/* Text of values that are not printed yet: keys and values of a table, and a line for each. */
static GString *keys, *row, *lines;
static char *header; /* of the table under way, with its indentation */

static void json_add(const char *separator, const char *key, const char *text) {
    g_autoptr(GString) name = g_string_new(NULL);
    if (key) {
        json_append_string(name, key);
        g_string_append(name, ": ");
    }
    if (depth > 0 && levels[depth - 1].filled)
        fputs(separator, stdout);
    if (depth > 0)
        levels[depth - 1].filled = TRUE;
    printf("%s%s", name->str, text);
}

/* Prints the values of the innermost object or list. Its key is the name of the row if nothing else
 * is in it, or else a heading. */
static void print_values(gboolean more_follows) {
    struct level *level = &levels[depth - 1];
    const gboolean first = depth > 1 && !level->filled, wide = keys->len > WIDEST;
    const char *key = first ? level->key : NULL;
    const gboolean heads = key && (more_follows || wide);
    const int indent = 2 * (depth - (first && !heads ? 2 : 1)), name = key && !heads ? NAME : 0;
    g_autofree char *top = g_strdup_printf("%*s%s", indent + name, "", keys->str);
    if (heads || wide)
        printf("%*s%s\n", heads ? 2 * (depth - 2) : 0, "", heads ? key : "");
    if (wide)
        fputs(lines->str, stdout);
    else if (row->len > 0) {
        if (g_strcmp0(header, top) != 0)
            puts(top);
        printf("%*s%-*s%s\n", indent, "", name, name ? key : "", row->str);
    }
    if (heads || row->len > 0) {
        g_free(header);
        header = wide || row->len == 0 ? NULL : g_steal_pointer(&top);
    }
    level->filled = TRUE;
    g_string_truncate(keys, 0);
    g_string_truncate(row, 0);
    g_string_truncate(lines, 0);
    fflush(stdout);
}

static void begin(const char *key, gboolean list) {
    g_assert(depth < DEEPEST && (key != NULL) == (depth > 0 && !levels[depth - 1].list));
    if (!keys) {
        keys = g_string_new(NULL);
        row = g_string_new(NULL);
        lines = g_string_new(NULL);
    }
    if (json)
        json_add(",\n ", key, list ? "[" : "{");
    else if (depth > 0 && !levels[depth - 1].list)
        print_values(TRUE);
    levels[depth++] = (struct level){.key = g_strdup(key), .list = list};
    if (list && !json)
        print_values(TRUE);
}

void bench_begin(const char *key) {
    begin(key, FALSE);
}

void bench_begin_list(const char *key) {
    begin(key, TRUE);
}

void bench_end(void) {
    g_assert(depth > 0);
    if (!json)
        print_values(FALSE);
    g_free(levels[depth - 1].key);
    depth--;
    if (json)
        printf("%c%s", levels[depth].list ? ']' : '}', depth == 0 ? "\n" : "");
    fflush(stdout);
}

/* Widths count characters. */
static void append_padded(GString *to, const char *text, int width, gboolean left) {
    const int missing = MAX(width - (int)g_utf8_strlen(text, -1), 0);
    g_string_append_printf(to, "%*s%s%*s  ", left ? 0 : missing, "", text, left ? missing : 0, "");
}

/* text: NULL if there is no number. */
static void put(const char *key, const char *text, int width, gboolean is_string) {
    g_assert(depth > 0 && !levels[depth - 1].list);
    if (json) {
        g_autoptr(GString) quoted = g_string_new(is_string ? NULL : text ? text : "null");
        if (is_string)
            json_append_string(quoted, text);
        json_add(", ", key, quoted->str);
        return;
    }
    width = MAX(MAX(width, is_string ? TEXT : NUMBER), (int)g_utf8_strlen(key, -1));
    append_padded(keys, key, width, is_string);
    append_padded(row, text ? text : "–", width, is_string);
    g_string_append_printf(lines, "%*s%-*s %s\n", 2 * depth, "", KEY, key, text ? text : "–");
}

/* NULL if the value is not finite. */
static char *double_text(const char *format, double value) {
    return isfinite(value) ? g_strstrip(g_strdup_printf(format, value)) : NULL;
}

/* Puts the value of one conversion. */
static void put_next(const char *key, const char *format, va_list *arguments) {
    const int width = atoi(format + 1 + strspn(format + 1, "-+ 0"));
    g_autofree char *text = NULL;
    switch (format[strlen(format) - 1]) {
    case 's':
        put(key, va_arg(*arguments, const char *), width, TRUE);
        return;
    case 'd':
    case 'i':
    case 'u':
        text = strpbrk(format, "lz") ? g_strdup_printf(format, va_arg(*arguments, long))
                                     : g_strdup_printf(format, va_arg(*arguments, int));
        g_strstrip(text);
        break;
    case 'f':
    case 'g':
        text = double_text(format, va_arg(*arguments, double));
        break;
    default:
        g_error("a bench cannot print %s", format);
    }
    put(key, text, width, FALSE);
}

static void put_all(const char *format, va_list *arguments) {
    for (const char *at = strchr(format, '%'); at; at = strchr(at, '%')) {
        const char *key = strchr(at, '{'), *end = strchr(at, '}');
        g_assert(key && end > key);
        g_autofree char *one = g_strndup(at, (gsize)(key - at));
        g_autofree char *name = g_strndup(key + 1, (gsize)(end - key - 1));
        put_next(name, one, arguments);
        at = end;
    }
}

void bench_put(const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    put_all(format, &arguments);
    va_end(arguments);
}

void bench_put_boolean(const char *key, gboolean value) {
    put(key, value ? "true" : "false", 0, FALSE);
}

void bench_put_double(const char *of, const char *what, const char *format, double value) {
    g_autofree char *key = g_strconcat(of, what, NULL), *text = double_text(format, value);
    put(key, text, 0, FALSE);
}

void bench_put_doubles(const char *key, const char *format, const double *values, int n) {
    g_autoptr(GString) all = g_string_new(json ? "[" : NULL);
    for (int i = 0; i < n; i++) {
        g_autofree char *text = double_text(format, values[i]);
        g_string_append_printf(all, "%s%s",
                               i == 0 ? ""
                               : json ? ", "
                                      : " ",
                               text   ? text
                               : json ? "null"
                                      : "–");
    }
    g_string_append(all, json ? "]" : "");
    put(key, all->str, NUMBER * n, FALSE);
}

void bench_row(const char *key, const char *format, ...) {
    va_list arguments;
    bench_begin(key);
    va_start(arguments, format);
    put_all(format, &arguments);
    va_end(arguments);
    bench_end();
}

double bench_now_s(void) {
    return (double)g_get_monotonic_time() / G_USEC_PER_SEC;
}

double bench_cpu_s(void) {
    return (double)clock() / CLOCKS_PER_SEC;
}

double bench_time_quantile(double *values, int n, double q) {
    qsort(values, (gsize)n, sizeof *values, robust_by_value);
    return values[(int)(q * (n - 1))];
}

struct bench_times bench_times(double *values, int n) {
    const double median = bench_time_quantile(values, n, 0.5);
    return (struct bench_times){median, bench_time_quantile(values, n, 0.99)};
}
