/* The options of the command compress. They and their help texts come from the tables of all
 * codecs. */
#include "compress.h"

#include <string.h>

#define MAX_METHODS 64
#define MAX_OPTIONS 64

/* An option of the command line; several methods may take it. */
struct given {
    const char *name;
    enum option_type type;
    char *text;    /* NULL if not given */
    gboolean flag; /* value of an option of the type OPTION_BOOL */
};

static struct compress_method methods[MAX_METHODS];
static struct given options[MAX_OPTIONS];
static int n_methods, n_options;
static char *method_option, *output_option;

/* --memory, which belongs to all codecs whose member `bounded` is TRUE. */
static const struct option memory = {
    .name = "memory",
    .type = OPTION_BYTES,
    .help = "maximum memory; a larger BTF is kept in a temporary file"};

static const struct option *find(const struct compress_method *method, const char *name) {
    if (g_str_equal(name, memory.name))
        return method->codec && method->codec->bounded ? &memory : NULL;
    return options_find(method->options, name);
}

static void list_option(const struct option *option) {
    for (int i = 0; i < n_options; i++)
        if (g_str_equal(options[i].name, option->name))
            return;
    g_assert_cmpint(n_options, <, MAX_OPTIONS);
    options[n_options++] = (struct given){.name = option->name, .type = option->type};
}

static void list_method(struct compress_method method) {
    g_assert_cmpint(n_methods, <, MAX_METHODS);
    methods[n_methods++] = method;
    for (const struct option *option = method.options; option->name; option++)
        list_option(option);
}

/* Returns the names of all methods that take an option, or of all methods if option is NULL. Free
 * the text with g_free(). */
static char *method_names(const char *option, const char *separator) {
    GString *names = g_string_new(NULL);
    for (int i = 0; i < n_methods; i++)
        if (!option || find(&methods[i], option))
            g_string_append_printf(names, "%s%s", names->len ? separator : "", methods[i].name);
    return g_string_free(names, FALSE);
}

/* Returns the help text of an option, such as "fields, ptm: HELP". Methods that have the same text
 * for the option share a line. */
static const char *help_of(const char *name) {
    g_autoptr(GString) text = g_string_new(NULL);
    const char *last = NULL;
    for (int i = 0; i < n_methods; i++) {
        const struct option *option = find(&methods[i], name);
        if (!option || option->help == last)
            continue;
        g_string_append(text, last ? "\v" : "");
        for (int k = i; k < n_methods; k++) {
            const struct option *other = find(&methods[k], name);
            if (other && other->help == option->help)
                g_string_append_printf(text, "%s%s", k > i ? ", " : "", methods[k].name);
        }
        g_string_append_printf(text, ": %s", option->help);
        g_autofree char *range = option->max < G_MAXDOUBLE ? options_range(option) : NULL;
        if (range)
            g_string_append_printf(text, "; %s", range);
        if (option->type == OPTION_CHOICE)
            g_string_append_printf(text, " (%s)", option->fallback);
        last = option->help;
    }
    return g_intern_string(text->str);
}

/* Returns the choices of an option, over all methods, with | between them. */
static const char *choices(const char *name) {
    g_autoptr(GString) text = g_string_new(NULL);
    g_autoptr(GHashTable) seen = g_hash_table_new(g_str_hash, g_str_equal);
    for (int i = 0; i < n_methods; i++) {
        const struct option *option = find(&methods[i], name);
        for (int k = 0; option && option->choices && option->choices[k]; k++)
            if (g_hash_table_add(seen, (gpointer)option->choices[k]))
                g_string_append_printf(text, "%s%s", text->len ? "|" : "", option->choices[k]);
    }
    return g_intern_string(text->str);
}

static GOptionEntry entry_of(struct given *given) {
    static const struct {
        const char *name;
        char letter;
    } letters[] = {{"clusters", 'k'}, {"grid", 'g'}, {"quantise", 'q'}};
    GOptionEntry entry = {.long_name = given->name,
                          .arg = G_OPTION_ARG_STRING,
                          .arg_data = &given->text,
                          .description = help_of(given->name),
                          .arg_description = "N"};
    for (gsize i = 0; i < G_N_ELEMENTS(letters); i++)
        if (g_str_equal(letters[i].name, given->name))
            entry.short_name = letters[i].letter;
    if (given->type == OPTION_BOOL) {
        entry.arg = G_OPTION_ARG_NONE;
        entry.arg_data = &given->flag;
        entry.arg_description = NULL;
    } else if (given->type == OPTION_CHOICE) {
        entry.arg_description = choices(given->name);
    } else if (given->type != OPTION_INT) {
        entry.arg_description = given->name == memory.name    ? "512MB"
                                : given->type == OPTION_SHARE ? "2%"
                                : given->type == OPTION_BYTES ? "20MB"
                                                              : "VALUE";
    }
    return entry;
}

const GOptionEntry *compress_entries(void) {
    static GOptionEntry entries[MAX_OPTIONS + 3];
    int n = 0;
    n_methods = n_options = 0;
    for (gsize i = 0; codecs[i]; i++)
        list_method((struct compress_method){codecs[i]->name, codecs[i]->help, codecs[i]->options,
                                             codecs[i]->options_size, .codec = codecs[i]});
    for (gsize i = 0; mdf_codecs[i]; i++)
        list_method((struct compress_method){mdf_codecs[i]->name, mdf_codecs[i]->help,
                                             mdf_codecs[i]->options, mdf_codecs[i]->options_size,
                                             .mdf = mdf_codecs[i]});
    list_option(&memory);
    g_autofree char *names = method_names(NULL, "|");
    g_autoptr(GString) help = g_string_new("How to compress (lpca):");
    for (int i = 0; i < n_methods; i++)
        g_string_append_printf(help, "\v%s: %s", methods[i].name, methods[i].help);
    entries[n++] = (GOptionEntry){"method",
                                  'm',
                                  0,
                                  G_OPTION_ARG_STRING,
                                  &method_option,
                                  g_intern_string(help->str),
                                  g_intern_string(names)};
    for (int i = 0; i < n_options; i++)
        entries[n++] = entry_of(&options[i]);
    entries[n++] = (GOptionEntry){"output",
                                  'o',
                                  0,
                                  G_OPTION_ARG_FILENAME,
                                  &output_option,
                                  "File to write (products/METHOD.exr of the session)",
                                  "FILE"};
    entries[n] = (GOptionEntry){NULL};
    return entries;
}

/* Returns the command line as it was given, so that the same command can be run again. */
static char *made_by(void) {
    g_autofree char *output = output_option ? g_canonicalize_filename(output_option, NULL) : NULL;
    const struct {
        const char *name, *text;
    } texts[] = {{"method", method_option}, {"output", output}};
    GString *text = g_string_new("compress");
    for (gsize i = 0; i < G_N_ELEMENTS(texts); i++) {
        g_autofree char *quoted = texts[i].text ? g_shell_quote(texts[i].text) : NULL;
        if (quoted)
            g_string_append_printf(text, " --%s=%s", texts[i].name, quoted);
    }
    for (int i = 0; i < n_options; i++) {
        const struct given *given = &options[i];
        g_autofree char *quoted = !given->text                ? NULL
                                  : given->type == OPTION_INT ? g_strdup(given->text)
                                                              : g_shell_quote(given->text);
        if (quoted)
            g_string_append_printf(text, " --%s=%s", given->name, quoted);
        else if (given->flag)
            g_string_append_printf(text, " --%s", given->name);
    }
    return g_string_free(text, FALSE);
}

static gboolean set(const struct command *command, const struct given *given,
                    struct compress_asked *asked) {
    g_autoptr(GError) error = NULL;
    if (!given->text && !given->flag)
        return TRUE;
    const struct option *option = find(&asked->method, given->name);
    if (!option) {
        g_autofree char *names = method_names(given->name, ", ");
        cli_usage(command,
                  "--method=%s has no option --%s: leave that option out, or choose a method that "
                  "has it: %s",
                  asked->method.name, given->name, names);
        return FALSE;
    }
    if (options_set(option, given->flag ? "yes" : given->text,
                    option == &memory ? &asked->memory : asked->options, &error))
        return TRUE;
    cli_usage(command, "--%s: %s", given->name, error->message);
    return FALSE;
}

gboolean compress_ask(const struct call *call, struct compress_asked *ret) {
    int m = 0;
    *ret = (struct compress_asked){.path = call->arguments[0], .output = output_option};
    while (method_option && m < n_methods && !g_str_equal(methods[m].name, method_option))
        m++;
    if (m == n_methods) {
        g_autofree char *names = method_names(NULL, ", ");
        cli_usage(call->command, "there is no --method=%s; choose from: %s", method_option, names);
        return FALSE;
    }
    const struct codec *codec = methods[m].codec;
    ret->method = methods[m];
    ret->made_by = made_by();
    ret->options = g_malloc0(MAX(methods[m].options_size, 1));
    options_defaults(methods[m].options, ret->options);
    for (int i = 0; i < n_options; i++)
        if (!set(call->command, &options[i], ret))
            return FALSE;
    const char *what = codec && codec->check ? codec->check(ret->options, ret->memory) : NULL;
    if (what)
        cli_usage(call->command, "%s", what);
    else if (!ret->output && (!codec || codec->from_process))
        cli_usage(call->command,
                  "--method=%s: give -o FILE, because “mesorig process” writes the session's own "
                  "file of this method, which must not be replaced",
                  methods[m].name);
    else
        return TRUE;
    return FALSE;
}

void compress_clear(struct compress_asked *asked) {
    if (asked->options)
        options_clear(asked->method.options, asked->options);
    g_free(asked->options);
    g_free(asked->made_by);
}

char *compress_inputs(const struct compress_asked *asked) {
    GString *text = g_string_new(asked->method.name);
    for (const struct option *option = asked->method.options; option->name; option++) {
        const char *field = (const char *)asked->options + option->offset;
        g_string_append_printf(text, ", %s ", option->name);
        if (option->type == OPTION_BYTES)
            g_string_append_printf(text, "%" G_GINT64_FORMAT, *(const gint64 *)(gpointer)field);
        else if (option->type == OPTION_SHARE || option->type == OPTION_DOUBLE)
            g_string_append_printf(text, "%.17g", *(const double *)(gpointer)field);
        else if (option->type == OPTION_STRING || option->type == OPTION_PATH)
            g_string_append(text, *(char *const *)(gpointer)field);
        else
            g_string_append_printf(text, "%d", *(const int *)(gpointer)field);
    }
    g_string_append_printf(text, ", in %" G_GINT64_FORMAT " bytes", asked->memory);
    return g_string_free(text, FALSE);
}
