#include "config.h"

#include "error_details.h"

#include "input_file.h"

#include <string.h>

#define MAX_BYTES (1024 * 1024)

/*
 * This parser replaces that of GKeyFile, which keeps no line numbers and merges sections and keys
 * that occur twice. Escapes are not interpreted. A value is the trimmed text between '=' and the
 * end of the line.
 */

struct entry {
    char *value;
    int line;
};

struct Config {
    char *path, *text;
    GArray *sections;  /* elements: struct config_section */
    GHashTable *lines; /* key: "class name", owned; value: the line of that section */
    /* elements: struct config_problem; NULL if problems are added to mistakes instead */
    GArray *problems;
    Mistakes *mistakes; /* mistakes of the function that loads the file; NULL after loading */
    gboolean broken;    /* whether a section heading could not be parsed */
};

GQuark config_error_quark(void) {
    return error_details_domain("config_error");
}

static void entry_free(gpointer data) {
    struct entry *entry = data;
    g_free(entry->value);
    g_free(entry);
}

static void section_clear(gpointer data) {
    struct config_section *section = data;
    g_free(section->group);
    g_free(section->class_name);
    g_free(section->name);
    g_hash_table_unref(section->entries);
    g_ptr_array_unref(section->keys);
}

static void problem_clear(gpointer data) {
    g_free(((struct config_problem *)data)->message);
}

static gboolean G_GNUC_PRINTF(4, 5)
    syntax_error(GError **error, const Config *config, int line, const char *format, ...) {
    va_list args;
    va_start(args, format);
    GError *made = error_details_new_valist(CONFIG_ERROR, CONFIG_ERROR_SYNTAX, NULL, format, args);
    va_end(args);
    error_details_add_place(&made, config->path, line, NULL);
    g_propagate_error(error, made);
    return FALSE;
}

/* Adds a section. text is the trimmed text between the brackets. */
static gboolean add_section(Config *config, const char *text, int line, GError **error) {
    if (!*text || strpbrk(text, "[]"))
        return syntax_error(
            error, config, line,
            "\"[%s]\" is not the heading of a section: write [class] or [class name]", text);
    const gsize class_length = strcspn(text, " \t");
    const char *rest = text + class_length + strspn(text + class_length, " \t");
    g_autofree char *class_name = g_strndup(text, class_length);
    /* Extra spaces within the brackets are ignored. */
    g_autofree char *id = *rest ? g_strconcat(class_name, " ", rest, NULL) : g_strdup(class_name);
    const int before = GPOINTER_TO_INT(g_hash_table_lookup(config->lines, id));
    if (before)
        return syntax_error(error, config, line, "[%s] was given before, in line %d: merge the two",
                            text, before);
    const struct config_section section = {
        .config = config,
        .group = g_strdup(text),
        .class_name = g_steal_pointer(&class_name),
        .name = *rest ? g_strdup(rest) : NULL,
        .line = line,
        .keys = g_ptr_array_new_with_free_func(g_free),
        .entries = g_hash_table_new_full(g_str_hash, g_str_equal, NULL, entry_free)};
    g_hash_table_insert(config->lines, g_steal_pointer(&id), GINT_TO_POINTER(line));
    g_array_append_val(config->sections, section);
    return TRUE;
}

/* Returns the section that the present line belongs to, or NULL before the first section. */
static struct config_section *last_section(const Config *config) {
    const guint n = config->sections->len;
    return n ? &g_array_index(config->sections, struct config_section, n - 1) : NULL;
}

static gboolean add_entry(Config *config, char *text, int line, GError **error) {
    static const char key_characters[] = G_CSET_A_2_Z G_CSET_a_2_z G_CSET_DIGITS "_-.";
    const struct config_section *section = last_section(config);
    if (!section)
        return syntax_error(
            error, config, line,
            "this line comes before the first [section]: move it into a section, or remove it");
    char *equals = strchr(text, '=');
    if (!equals)
        return syntax_error(error, config, line,
                            "[%s]: this line is neither \"key = value\" nor a [section]: correct "
                            "or remove this line",
                            section->group);
    *equals = '\0';
    const char *key = g_strstrip(text), *value = g_strstrip(equals + 1);
    if (!*key || key[strspn(key, key_characters)])
        return syntax_error(
            error, config, line,
            "[%s]: \"%s\" is not a key: a key consists of letters, digits, '_', '-' and '.'",
            section->group, key);
    const struct entry *before = g_hash_table_lookup(section->entries, key);
    if (before)
        return syntax_error(error, config, line,
                            "[%s] %s: was given before, in line %d: remove one of the two",
                            section->group, key, before->line);
    struct entry *entry = g_new0(struct entry, 1);
    entry->value = g_strdup(value);
    entry->line = line;
    char *owned = g_strdup(key);
    g_ptr_array_add(section->keys, owned);
    g_hash_table_insert(section->entries, owned, entry);
    return TRUE;
}

static gboolean parse_line(Config *config, char *text, int line, GError **error) {
    if (!g_utf8_validate(text, -1, NULL))
        return syntax_error(error, config, line,
                            "this line is not text in UTF-8: save the file as UTF-8");
    g_strstrip(text);
    if (!*text || *text == '#')
        return TRUE;
    for (const char *c = text; *c; c++)
        if (g_ascii_iscntrl(*c) && *c != '\t')
            return syntax_error(
                error, config, line,
                "this line contains the control character with the number %d: remove it", *c);
    if (*text != '[')
        return add_entry(config, text, line, error);
    const gsize length = strlen(text);
    if (text[length - 1] != ']')
        return syntax_error(error, config, line,
                            strchr(text, ']')
                                ? "text follows the ']' of the heading: move it to the next line"
                                : "the heading lacks its ']' at the end: add it");
    text[length - 1] = '\0';
    return add_section(config, g_strstrip(text + 1), line, error);
}

/* Parses a line. Leaves out a line that cannot be understood, and records the problem. */
static void take_line(Config *config, char *text, int line) {
    struct config_section *last = last_section(config);
    g_autofree char *copy = g_strdup(g_strstrip(text));
    GError *error = NULL;
    /* Each section has at most one key "driver". A second one shows that the heading of another
     * section is missing above it. */
    const gboolean second = last && g_str_has_prefix(text, "driver") &&
                            strcspn(text, " \t=") == strlen("driver") &&
                            config_value(last, "driver", NULL);
    if (parse_line(config, copy, line, &error))
        return;
    if (config->problems) {
        const struct config_problem problem = {g_strdup(error->message), line};
        g_array_append_val(config->problems, problem);
        g_error_free(error);
    } else {
        mistakes_add(config->mistakes, error);
    }
    /* A broken heading also begins a section, so that the keys after it are not added to the
     * section before. */
    const gboolean heading = *text == '[' || (!strchr(text, '=') && strpbrk(text, "[]"));
    if (last && !heading)
        last->incomplete = !config->problems;
    if (second || heading) {
        g_autofree char *plain = g_utf8_make_valid(second ? "" : text, -1);
        g_strstrip(g_strdelimit(plain, "[]", ' '));
        g_autofree char *named =
            g_strdup_printf("%s (line %d)", *plain ? plain : CONFIG_NO_HEADING, line);
        config->broken = TRUE;
        if (add_section(config, named, line, NULL))
            last_section(config)->broken = !config->problems;
    }
    if (second)
        parse_line(config, text, line, NULL);
}

static int line_at(const char *text, const char *at) {
    int line = 1;
    for (; text < at; text++)
        line += *text == '\n';
    return line;
}

/* Parses the whole text. Returns FALSE and adds a mistake if the file is not text. */
static gboolean do_parse(Config *config, gsize length) {
    const char *text = config->text;
    GError *error = NULL;
    if (input_file_is_utf16(text, length)) {
        syntax_error(&error, config, 1, INPUT_FILE_UTF16);
        return mistakes_add(config->mistakes, error);
    }
    if (strlen(text) != length) {
        syntax_error(
            &error, config, line_at(text, text + strlen(text)),
            "this line contains a NUL byte, so the file is not a text: copy the file again");
        return mistakes_add(config->mistakes, error);
    }
    if (g_str_has_prefix(text, INPUT_FILE_MARK))
        text += strlen(INPUT_FILE_MARK);
    g_auto(GStrv) lines = g_strsplit(text, "\n", -1);
    for (int i = 0; lines[i]; i++)
        take_line(config, lines[i], i + 1);
    return TRUE;
}

/* Makes a Config from a text that ends with a NUL, and takes ownership of the text. A NUL inside
 * the text is a mistake. If mistakes is NULL, the text is read as config_load_lenient() reads a
 * file. */
static Config *config_new(char *text, gsize length, const char *path, Mistakes *mistakes) {
    Config *config = g_new0(Config, 1);
    config->mistakes = mistakes;
    if (!mistakes) {
        config->problems = g_array_new(FALSE, TRUE, sizeof(struct config_problem));
        g_array_set_clear_func(config->problems, problem_clear);
    }
    config->path = g_strdup(path);
    config->text = text;
    config->sections = g_array_new(FALSE, TRUE, sizeof(struct config_section));
    g_array_set_clear_func(config->sections, section_clear);
    config->lines = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, NULL);
    if (!do_parse(config, length)) {
        config_free(config);
        return NULL;
    }
    config->mistakes = NULL;
    for (guint i = 0; i < config->sections->len; i++)
        g_ptr_array_add(g_array_index(config->sections, struct config_section, i).keys, NULL);
    return config;
}

static char *read_file(const char *path, gsize *ret_length, GError **error) {
    GError *why = NULL;
    char *text = input_file_read(path, MAX_BYTES, ret_length, &why);
    if (!text)
        input_file_propagate(why, CONFIG_ERROR, -1, CONFIG_ERROR_SYNTAX, error);
    return text;
}

Config *config_load_checked(const char *path, Mistakes *mistakes) {
    g_return_val_if_fail(path && mistakes, NULL);
    gsize length;
    GError *error = NULL;
    char *text = read_file(path, &length, &error);
    mistakes_add(mistakes, error);
    return text ? config_new(text, length, path, mistakes) : NULL;
}

/* Returns config if there are no mistakes. Otherwise frees config, sets the error and returns
 * NULL. */
static Config *without(Config *config, const Mistakes *mistakes, GError **error) {
    if (mistakes_report(mistakes, error))
        return config;
    config_free(config);
    return NULL;
}

Config *config_load(const char *path, GError **error) {
    g_autoptr(Mistakes) mistakes = mistakes_new();
    return without(config_load_checked(path, mistakes), mistakes, error);
}

Config *config_load_lenient(const char *path, GError **error) {
    g_return_val_if_fail(path, NULL);
    gsize length;
    g_autofree char *bytes = read_file(path, &length, error);
    if (!bytes)
        return NULL;
    for (gsize i = 0; i < length; i++)
        if (bytes[i] == '\0')
            bytes[i] = '\1'; /* the parser refuses lines with control characters */
    char *text = g_utf8_make_valid(bytes, (gssize)length);
    return config_new(text, strlen(text), path, NULL);
}

const struct config_problem *config_problems(const Config *config, gsize *ret_n) {
    *ret_n = config->problems ? config->problems->len : 0;
    return config->problems ? (const struct config_problem *)(gpointer)config->problems->data
                            : NULL;
}

Config *config_parse_checked(const char *text, const char *path, Mistakes *mistakes) {
    g_return_val_if_fail(text && path && mistakes, NULL);
    gsize length = strlen(text);
    if (length > MAX_BYTES) {
        mistakes_add(
            mistakes,
            g_error_new(CONFIG_ERROR, CONFIG_ERROR_SYNTAX,
                        "%s: the text has %" G_GSIZE_FORMAT
                        " bytes, but a configuration file has at most 1 MiB: name another file",
                        path, length));
        return NULL;
    }
    return config_new(g_strdup(text), length, path, mistakes);
}

Config *config_parse(const char *text, const char *path, GError **error) {
    g_autoptr(Mistakes) mistakes = mistakes_new();
    return without(config_parse_checked(text, path, mistakes), mistakes, error);
}

gboolean config_has_all_sections(const Config *config) {
    return !config->broken;
}

void config_free(Config *config) {
    if (!config)
        return;
    g_hash_table_unref(config->lines);
    g_array_unref(config->sections);
    g_clear_pointer(&config->problems, g_array_unref);
    g_free(config->path);
    g_free(config->text);
    g_free(config);
}

const char *config_path(const Config *config) {
    return config->path;
}

const char *config_text(const Config *config) {
    return config->text;
}

const struct config_section *config_sections(const Config *config, gsize *ret_n) {
    *ret_n = config->sections->len;
    return (const struct config_section *)(gpointer)config->sections->data;
}

const struct config_section *config_find(const Config *config, const char *class_name,
                                         const char *name) {
    const struct config_section *found = NULL;
    for (guint i = 0; i < config->sections->len; i++) {
        const struct config_section *section =
            &g_array_index(config->sections, struct config_section, i);
        if (section->broken || strcmp(section->class_name, class_name) != 0)
            continue;
        if (name && g_strcmp0(section->name, name) == 0)
            return section;
        if (!name && found)
            return NULL;
        if (!name)
            found = section;
    }
    return found;
}

const char *config_value(const struct config_section *section, const char *key, int *ret_line) {
    const struct entry *entry = g_hash_table_lookup(section->entries, key);
    if (ret_line && entry)
        *ret_line = entry->line;
    return entry ? entry->value : NULL;
}

const char *const *config_keys(const struct config_section *section) {
    return (const char *const *)section->keys->pdata;
}

char *config_resolve(const Config *config, const char *path) {
    if (g_path_is_absolute(path))
        return g_canonicalize_filename(path, NULL);
    g_autofree char *file = g_canonicalize_filename(config->path, NULL);
    g_autofree char *folder = g_path_get_dirname(file);
    return g_canonicalize_filename(path, folder);
}

static GError *error_at(enum config_error code, const Config *config,
                        const struct config_section *section, const char *key, const char *format,
                        va_list args) G_GNUC_PRINTF(5, 0);
static GError *error_at(enum config_error code, const Config *config,
                        const struct config_section *section, const char *key, const char *format,
                        va_list args) {
    GError *made = error_details_new_valist(CONFIG_ERROR, (gint)code, NULL, format, args);
    int line = section ? section->line : 0;
    if (section && key)
        config_value(section, key, &line);
    g_autofree char *where =
        section ? g_strdup_printf("[%s]%s%s", section->group, key ? " " : "", key ? key : "")
                : NULL;
    error_details_add_place(&made, config_path(config), line, where);
    return made;
}

gboolean config_set_error(GError **error, enum config_error code,
                          const struct config_section *section, const char *key, const char *format,
                          ...) {
    va_list args;
    va_start(args, format);
    GError *made = error_at(code, section->config, section, key, format, args);
    va_end(args);
    g_propagate_error(error, made);
    return FALSE;
}

gboolean config_mistake(Mistakes *mistakes, enum config_error code,
                        const struct config_section *section, const char *key, const char *format,
                        ...) {
    va_list args;
    va_start(args, format);
    GError *made = error_at(code, section->config, section, key, format, args);
    va_end(args);
    return mistakes_add(mistakes, made);
}

gboolean config_lacks(Mistakes *mistakes, const Config *config, const char *format, ...) {
    va_list args;
    va_start(args, format);
    GError *made = error_at(CONFIG_ERROR_MISSING, config, NULL, NULL, format, args);
    va_end(args);
    return mistakes_add(mistakes, made);
}
