/* compress: its options and their help are those of the tables of all codecs. */
#include "compress.h"

#include <string.h>

#define MOST_METHODS 64
#define MOST_OPTIONS 64

/* An option of the command line; several methods may take it. */
struct given {
    const char *name;
    enum option_type type;
    char *text;    /* NULL: not given */
    gboolean flag; /* of OPTION_BOOL */
};

static struct compress_method methods[MOST_METHODS];
static struct given options[MOST_OPTIONS];
static int n_methods, n_options;
static char *method_option, *memory_option, *output_option;

static void compress_list_options(const struct option *option) {
    for (; option->name; option++) {
        int i = 0;
        while (i < n_options && !g_str_equal(options[i].name, option->name))
            i++;
        g_assert_cmpint(i, <, MOST_OPTIONS);
        if (i == n_options)
            options[n_options++] = (struct given){.name = option->name, .type = option->type};
    }
}

static void compress_list_method(struct compress_method method) {
    g_assert_cmpint(n_methods, <, MOST_METHODS);
    methods[n_methods++] = method;
    compress_list_options(method.options);
}

static void compress_list_methods(void) {
    n_methods = n_options = 0;
    for (gsize i = 0; codecs[i]; i++) {
        const struct codec *codec = codecs[i];
        compress_list_method((struct compress_method){codec->name, codec->help, codec->options,
                                                      codec->options_size, codec, NULL});
    }
    for (gsize i = 0; mdf_codecs[i]; i++) {
        const struct mdf_codec *mdf = mdf_codecs[i];
        compress_list_method((struct compress_method){mdf->name, mdf->help, mdf->options,
                                                      mdf->options_size, NULL, mdf});
    }
}

static const struct option *compress_find(const struct compress_method *method, const char *name) {
    for (const struct option *option = method->options; option->name; option++)
        if (g_str_equal(option->name, name))
            return option;
    return NULL;
}

static gboolean compress_takes(const struct compress_method *method, const char *option) {
    if (g_str_equal(option, "memory"))
        return method->codec && method->codec->bounded;
    return compress_find(method, option) != NULL;
}

/* Names of all methods that take an option, NULL: of all methods. g_free() */
static char *compress_names(const char *option, const char *separator) {
    GString *names = g_string_new(NULL);
    for (int i = 0; i < n_methods; i++)
        if (!option || compress_takes(&methods[i], option))
            g_string_append_printf(names, "%s%s", names->len ? separator : "", methods[i].name);
    return g_string_free(names, FALSE);
}

/* "lpca: what it is there; fields, ptm: what it is there". Methods that say the same share it. */
static const char *compress_help(const char *name) {
    g_autoptr(GString) text = g_string_new(NULL);
    const char *last = NULL;
    for (int i = 0; i < n_methods; i++) {
        const struct option *option = compress_find(&methods[i], name);
        if (!option || option->help == last)
            continue;
        g_string_append(text, last ? "; " : "");
        for (int k = i; k < n_methods; k++) {
            const struct option *other = compress_find(&methods[k], name);
            if (other && other->help == option->help)
                g_string_append_printf(text, "%s%s", k > i ? ", " : "", methods[k].name);
        }
        g_string_append_printf(text, ": %s", option->help);
        g_autofree char *range = option->max < G_MAXDOUBLE ? options_range(option) : NULL;
        if (range)
            g_string_append_printf(text, " (%s)", range);
        if (option->type == OPTION_CHOICE)
            g_string_append_printf(text, " (default %s)", option->fallback);
        last = option->help;
    }
    return g_intern_string(text->str);
}

/* All choices that some method has. */
static const char *compress_choices(const char *name) {
    g_autoptr(GString) text = g_string_new(NULL);
    g_autoptr(GHashTable) seen = g_hash_table_new(g_str_hash, g_str_equal);
    for (int i = 0; i < n_methods; i++) {
        const struct option *option = compress_find(&methods[i], name);
        for (int k = 0; option && option->choices[k]; k++)
            if (g_hash_table_add(seen, (gpointer)option->choices[k]))
                g_string_append_printf(text, "%s%s", text->len ? "|" : "", option->choices[k]);
    }
    return g_intern_string(text->str);
}

static GOptionEntry compress_entry(struct given *given) {
    static const struct {
        const char *name;
        char letter;
    } letters[] = {{"clusters", 'k'}, {"components", 'c'}, {"error", 'e'},
                   {"size", 's'},     {"grid", 'g'},       {"quantise", 'q'}};
    GOptionEntry entry = {.long_name = given->name,
                          .arg = G_OPTION_ARG_STRING,
                          .arg_data = &given->text,
                          .description = compress_help(given->name),
                          .arg_description = "N"};
    for (gsize i = 0; i < G_N_ELEMENTS(letters); i++)
        if (g_str_equal(letters[i].name, given->name))
            entry.short_name = letters[i].letter;
    if (given->type == OPTION_BOOL) {
        entry.arg = G_OPTION_ARG_NONE;
        entry.arg_data = &given->flag;
        entry.arg_description = NULL;
    } else if (given->type == OPTION_CHOICE) {
        entry.arg_description = compress_choices(given->name);
    } else if (given->type != OPTION_INT) {
        entry.arg_description = given->type == OPTION_SHARE   ? "2%"
                                : given->type == OPTION_BYTES ? "20MB"
                                                              : "VALUE";
    }
    return entry;
}

static const char *compress_method_help(void) {
    g_autoptr(GString) text = g_string_new("What to compress with");
    for (int i = 0; i < n_methods; i++)
        g_string_append_printf(text, "%s %s%s: %s", i ? ";" : ":", methods[i].name,
                               i ? "" : " (the default)", methods[i].help);
    return g_intern_string(text->str);
}

static GArray *compress_entries(void) {
    g_autofree char *names = compress_names(NULL, "|"), *bounded = compress_names("memory", ", ");
    g_autofree char *memory = g_strdup_printf(
        "%s: take no more than this; a BTF that is larger stays in a temporary file", bounded);
    const GOptionEntry first[] = {
        {"method", 'm', 0, G_OPTION_ARG_STRING, &method_option, compress_method_help(),
         g_intern_string(names)},
        {"model", 0, 0, G_OPTION_ARG_STRING, &method_option, "The same as --method", "METHOD"},
    };
    const GOptionEntry last[] = {
        {"memory", 0, 0, G_OPTION_ARG_STRING, &memory_option, g_intern_string(memory), "512MB"},
        {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output_option,
         "Write this file, not products/METHOD.exr of the session", "FILE"},
    };
    GArray *entries = g_array_new(TRUE, FALSE, sizeof(GOptionEntry));
    g_array_append_vals(entries, first, G_N_ELEMENTS(first));
    for (int i = 0; i < n_options; i++) {
        const GOptionEntry entry = compress_entry(&options[i]);
        g_array_append_val(entries, entry);
    }
    g_array_append_vals(entries, last, G_N_ELEMENTS(last));
    return entries;
}

/* With the options that were given, in words that the same command understands. */
static char *compress_made_by(void) {
    g_autofree char *output = output_option ? cli_absolute(output_option) : NULL;
    const struct {
        const char *name, *text;
    } texts[] = {{"method", method_option}, {"memory", memory_option}, {"output", output}};
    GString *text = g_string_new("compress ");
    for (gsize i = 0; i < G_N_ELEMENTS(texts); i++) {
        g_autofree char *quoted = texts[i].text ? g_shell_quote(texts[i].text) : NULL;
        if (quoted)
            g_string_append_printf(text, "--%s=%s ", texts[i].name, quoted);
    }
    for (int i = 0; i < n_options; i++) {
        const struct given *given = &options[i];
        g_autofree char *quoted = !given->text                ? NULL
                                  : given->type == OPTION_INT ? g_strdup(given->text)
                                                              : g_shell_quote(given->text);
        if (quoted)
            g_string_append_printf(text, "--%s=%s ", given->name, quoted);
        else if (given->flag)
            g_string_append_printf(text, "--%s ", given->name);
    }
    return g_strchomp(g_string_free(text, FALSE));
}

static const struct compress_method *compress_find_method(const struct command *command) {
    for (int i = 0; i < n_methods; i++)
        if (!method_option || g_str_equal(methods[i].name, method_option))
            return &methods[i];
    g_autofree char *names = compress_names(NULL, ", ");
    cli_usage(command, "there is no --method=%s; choose from: %s", method_option, names);
    return NULL;
}

static gboolean compress_refuse(const struct command *command, const struct compress_method *method,
                                const char *option) {
    g_autofree char *names = compress_names(option, ", ");
    cli_usage(command, "--method=%s has no --%s; leave it out, or choose from: %s", method->name,
              option, names);
    return FALSE;
}

static gboolean compress_set(const struct command *command, const struct compress_method *method,
                             const struct given *given, gpointer target) {
    g_autoptr(GError) error = NULL;
    if (!given->text && !given->flag)
        return TRUE;
    const struct option *option = compress_find(method, given->name);
    if (!option)
        return compress_refuse(command, method, given->name);
    if (options_set(option, given->flag ? "yes" : given->text, target, &error))
        return TRUE;
    cli_usage(command, "--%s: %s", given->name, error->message);
    return FALSE;
}

static gboolean compress_set_memory(const struct command *command,
                                    const struct compress_method *method, gint64 *ret) {
    const struct option memory = {.name = "memory", .type = OPTION_BYTES};
    g_autoptr(GError) error = NULL;
    if (!memory_option)
        return TRUE;
    if (!compress_takes(method, "memory"))
        return compress_refuse(command, method, "memory");
    if (options_set(&memory, memory_option, ret, &error))
        return TRUE;
    cli_usage(command, "--memory: %s", error->message);
    return FALSE;
}

static gboolean compress_check(const struct command *command, const struct compress_asked *asked) {
    const struct codec *codec = asked->method.codec;
    const char *what = codec && codec->check ? codec->check(asked->options, asked->memory) : NULL;
    if (what)
        cli_usage(command, "%s", what);
    else if (!asked->output && (!codec || codec->from_process))
        cli_usage(command,
                  "--method=%s needs -o FILE: “mesorig process” writes what is in the session",
                  asked->method.name);
    else
        return TRUE;
    return FALSE;
}

gboolean compress_parse(const struct command *command, int *argc, char ***argv,
                        struct compress_asked *ret) {
    *ret = (struct compress_asked){0};
    compress_list_methods();
    g_autoptr(GArray) entries = compress_entries();
    if (!cli_parse(command, (const GOptionEntry *)(gpointer)entries->data, FALSE, argc, argv, 1, 1))
        return FALSE;
    const struct compress_method *method = compress_find_method(command);
    if (!method)
        return FALSE;
    ret->method = *method;
    ret->path = (*argv)[1];
    ret->output = output_option;
    ret->made_by = compress_made_by();
    ret->options = g_malloc0(MAX(method->options_size, 1));
    options_defaults(method->options, ret->options);
    for (int i = 0; i < n_options; i++)
        if (!compress_set(command, method, &options[i], ret->options))
            return FALSE;
    return compress_set_memory(command, method, &ret->memory) && compress_check(command, ret);
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
