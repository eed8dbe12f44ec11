#include "web_files.h"

#include "base/json.h"

#include <errno.h>
#include <fcntl.h>
#include <glib/gstdio.h>
#include <libsoup/soup.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define MAX_NAME        100
#define FILE_ENDING     ".conf"
#define SESSION_ENDING  ".session"
#define MAX_CALIBRATION (16 << 20) /* bytes, as in calibration.c */

gboolean web_files_is_name(const char *name) {
    const gsize n = strlen(name);
    if (n == 0 || n > MAX_NAME || *name == '.' || strchr(name, '/') ||
        !g_utf8_validate(name, -1, NULL))
        return FALSE;
    for (const char *at = name; *at; at = g_utf8_next_char(at))
        if (g_unichar_iscntrl(g_utf8_get_char(at)))
            return FALSE;
    return TRUE;
}

char *web_files_read(const char *path, gsize most, struct stat *ret_info) {
    const int descriptor = open(path, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
    if (descriptor < 0)
        return NULL;
    if (fstat(descriptor, ret_info) != 0 || !S_ISREG(ret_info->st_mode) ||
        (gsize)ret_info->st_size > most) {
        close(descriptor);
        errno = S_ISREG(ret_info->st_mode) ? EFBIG : EISDIR;
        return NULL;
    }
    char *text = g_malloc((gsize)ret_info->st_size + 1);
    const ssize_t n = read(descriptor, text, (size_t)ret_info->st_size);
    close(descriptor);
    text[MAX(n, 0)] = '\0';
    if (n >= 0 && strlen(text) == (gsize)n && g_utf8_validate(text, n, NULL))
        return text;
    g_free(text);
    errno = EILSEQ;
    return NULL;
}

/* Returns whether a text has the line of this section, such as "[session]". */
static gboolean has_section(const char *text, const char *section) {
    for (const char *at = text; (at = strstr(at, section)); at++)
        if (at == text || at[-1] == '\n')
            return TRUE;
    return FALSE;
}

static gint by_name(gconstpointer a, gconstpointer b) {
    return g_utf8_collate(*(char *const *)a, *(char *const *)b);
}

GPtrArray *web_files_names(const struct web_task *task, const char *ending) {
    GPtrArray *names = g_ptr_array_new_with_free_func(g_free);
    g_autoptr(GDir) dir = task->folder ? g_dir_open(task->folder, 0, NULL) : NULL;
    const char *entry;
    while (dir && (entry = g_dir_read_name(dir))) {
        g_autofree char *name = g_strdup(entry);
        if (!g_str_has_suffix(name, ending))
            continue;
        name[strlen(name) - strlen(ending)] = '\0';
        if (web_files_is_name(name))
            g_ptr_array_add(names, g_steal_pointer(&name));
    }
    g_ptr_array_sort(names, by_name);
    return names;
}

char *web_files_path(const struct web_task *task, const char *name, const char *ending) {
    g_autofree char *file = g_strconcat(name, ending, NULL);
    return g_build_filename(task->folder, file, NULL);
}

/* Answers {"folder": …, KEY: entries}. */
static void answer_list(const struct web_task *task, const char *key, GVariantBuilder *entries) {
    GVariantBuilder to;
    g_variant_builder_init(&to, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&to, "{sv}", "folder", g_variant_new_boolean(task->folder != NULL));
    g_variant_builder_add(&to, "{sv}", key, g_variant_builder_end(entries));
    g_autofree char *json = json_text(g_variant_builder_end(&to));
    web_task_answer(task, SOUP_STATUS_OK, json);
}

static void add_entry(GVariantBuilder *to, const char *name, const struct stat *info,
                      gboolean sized) {
    g_variant_builder_open(to, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(to, "{sv}", "name", g_variant_new_string(name));
    if (sized)
        g_variant_builder_add(to, "{sv}", "bytes", g_variant_new_int64(info->st_size));
    g_variant_builder_add(to, "{sv}", "changed", g_variant_new_int64(info->st_mtime));
    g_variant_builder_close(to);
}

void web_files_add_section(const struct web_task *task, const char *section,
                           GVariantBuilder *entries) {
    g_autoptr(GPtrArray) names = web_files_names(task, FILE_ENDING);
    int n = 0;
    for (guint i = 0; i < MIN(names->len, 2 * WEB_FILES_MAX) && n < WEB_FILES_MAX; i++) {
        struct stat info;
        g_autofree char *path = web_files_path(task, names->pdata[i], FILE_ENDING);
        g_autofree char *text = web_files_read(path, WEB_FILES_MAX_BYTES, &info);
        if (!text || !has_section(text, section))
            continue;
        add_entry(entries, names->pdata[i], &info, TRUE);
        n++;
    }
}

void web_files_list(const struct web_task *task) {
    GVariantBuilder entries;
    g_variant_builder_init(&entries, G_VARIANT_TYPE("aa{sv}"));
    web_files_add_section(task, "[session]", &entries);
    answer_list(task, "files", &entries);
}

void web_files_add(const struct web_task *task, const GPtrArray *names, const char *ending,
                   mode_t type, GVariantBuilder *entries) {
    for (guint i = 0; i < MIN(names->len, WEB_FILES_MAX); i++) {
        struct stat info;
        g_autofree char *path = web_files_path(task, names->pdata[i], ending);
        if (lstat(path, &info) == 0 && (info.st_mode & S_IFMT) == type)
            add_entry(entries, names->pdata[i], &info, type == S_IFREG);
    }
}

void web_files_sessions(const struct web_task *task) {
    g_autoptr(GPtrArray) names = web_files_names(task, SESSION_ENDING);
    GVariantBuilder entries;
    g_variant_builder_init(&entries, G_VARIANT_TYPE("aa{sv}"));
    web_files_add(task, names, SESSION_ENDING, S_IFDIR, &entries);
    answer_list(task, "sessions", &entries);
}

gboolean web_files_check(const struct web_task *task, const char *name) {
    if (!task->folder)
        web_task_refuse(task, SOUP_STATUS_NOT_FOUND,
                        "this server has no folder of sessions: start mesorig-web with "
                        "--sessions DIR");
    else if (!web_files_is_name(name))
        web_task_refuse(task, SOUP_STATUS_NOT_FOUND,
                        "a name has 1 to 100 bytes, no slash, and does not begin with a period");
    else
        return TRUE;
    return FALSE;
}

char *web_files_directory(const struct web_task *task, const char *name) {
    struct stat info;
    if (!web_files_check(task, name))
        return NULL;
    g_autofree char *path = web_files_path(task, name, SESSION_ENDING);
    if (lstat(path, &info) == 0 && S_ISDIR(info.st_mode))
        return g_steal_pointer(&path);
    g_autofree char *why = g_strdup_printf(
        "there is no session directory %s.session in the folder: /api/v1/sessions lists them",
        name);
    web_task_refuse(task, SOUP_STATUS_NOT_FOUND, why);
    return NULL;
}

/* Adds the text of a file as the option text_key of a D-Bus method. If path_key is not NULL, also
 * adds the path of the file as this option. If the file cannot be read, answers the task and
 * returns FALSE. */
static gboolean add_file(const struct web_task *task, const char *path, gsize most,
                         const char *path_key, const char *text_key, GVariantDict *to) {
    struct stat info;
    g_autofree char *text = web_files_read(path, most, &info);
    if (!text) {
        g_autofree char *name = g_path_get_basename(path);
        g_autofree char *why = g_strdup_printf(
            "the file %s cannot be read (%s): it must be a text file in UTF-8 of at most %zu KiB "
            "and no link; /api/v1/files and /api/v1/calibrations list the files",
            name, g_strerror(errno), most >> 10);
        web_task_refuse(task, SOUP_STATUS_NOT_FOUND, why);
        return FALSE;
    }
    if (path_key)
        g_variant_dict_insert(to, path_key, "s", path);
    g_variant_dict_insert(to, text_key, "s", text);
    return TRUE;
}

/* Calls Validate, Start or QueueAdd with the session file of a task, and with the calibration and
 * the session directory that the query names. flags names further keys of the query that become
 * options of the method. Their values are 0 or 1. */
static void call_with_file(const struct web_task *task, const char *method,
                           const char *const *flags, char *(*to_json)(GVariant *answer)) {
    const char *session = web_task_value(task, "session");
    const char *calibration = web_task_value(task, "calibration");
    g_auto(GVariantDict) options = G_VARIANT_DICT_INIT(NULL);
    if (!web_files_check(task, task->name) || (session && !web_files_check(task, session)) ||
        (calibration && !web_files_check(task, calibration)))
        return;
    for (int i = 0; flags[i]; i++) {
        gboolean value;
        if (!web_task_flag(task, flags[i], &value))
            return;
        g_variant_dict_insert(&options, flags[i], "b", value);
    }
    g_autofree char *path = web_files_path(task, task->name, FILE_ENDING);
    g_autofree char *directory =
        web_files_path(task, session ? session : task->name, SESSION_ENDING);
    g_autofree char *used =
        calibration ? web_files_path(task, calibration, WEB_FILES_CALIBRATION) : NULL;
    if (add_file(task, path, WEB_FILES_MAX_BYTES, NULL, "session_text", &options) &&
        (!used ||
         add_file(task, used, MAX_CALIBRATION, "calibration", "calibration_text", &options)))
        web_task_call(task, method,
                      g_variant_new("(ss@a{sv})", path, directory, g_variant_dict_end(&options)),
                      to_json);
}

/* Converts the answer of Validate, (bsa{sv}). */
static char *plan_json(GVariant *answer) {
    static const char *const keys[] = {"ok", "report", "plan"};
    GVariantBuilder to;
    g_variant_builder_init(&to, G_VARIANT_TYPE_VARDICT);
    for (gsize i = 0; i < G_N_ELEMENTS(keys); i++) {
        g_autoptr(GVariant) value = g_variant_get_child_value(answer, i);
        g_variant_builder_add(&to, "{sv}", keys[i], value);
    }
    return json_text(g_variant_builder_end(&to));
}

void web_files_plan(const struct web_task *task) {
    call_with_file(task, "Validate", (const char *const[]){NULL}, plan_json);
}

void web_files_start(const struct web_task *task) {
    call_with_file(task, "Start", (const char *const[]){"process", NULL}, NULL);
}

/* Converts the answer of QueueAdd, (ua{sv}). */
static char *number_json(GVariant *answer) {
    guint number;
    g_variant_get_child(answer, 0, "u", &number);
    return g_strdup_printf("{\"number\": %u}\n", number);
}

void web_files_queue(const struct web_task *task) {
    call_with_file(task, "QueueAdd", (const char *const[]){"process", "yes", NULL}, number_json);
}

void web_files_resume(const struct web_task *task) {
    GVariantDict options;
    gboolean process;
    if (!web_task_flag(task, "process", &process))
        return;
    g_autofree char *directory = web_files_directory(task, task->name);
    if (!directory)
        return;
    g_variant_dict_init(&options, NULL);
    g_variant_dict_insert(&options, "process", "b", process);
    web_task_call(task, "Resume",
                  g_variant_new("(s@a{sv})", directory, g_variant_dict_end(&options)), NULL);
}
