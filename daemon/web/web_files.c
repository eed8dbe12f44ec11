#include "web_files.h"

#include "base/json.h"

#include <errno.h>
#include <fcntl.h>
#include <glib/gstdio.h>
#include <libsoup/soup.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define MAX_NAME       100
#define FILE_ENDING    ".conf"
#define SESSION_ENDING ".session"

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

/* Returns the text of a session file; g_free(). Returns NULL with errno if it cannot be read, is a
 * link or no regular file, is too large, or is not UTF-8. A FIFO does not block. */
static char *read_file(const char *path, struct stat *ret_info) {
    const int descriptor = open(path, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
    if (descriptor < 0)
        return NULL;
    if (fstat(descriptor, ret_info) != 0 || !S_ISREG(ret_info->st_mode) ||
        ret_info->st_size > WEB_FILES_MAX_BYTES) {
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

/* Returns whether a text has the line [session], so that it is no rig file. */
static gboolean is_session(const char *text) {
    for (const char *at = text; (at = strstr(at, "[session]")); at++)
        if (at == text || at[-1] == '\n')
            return TRUE;
    return FALSE;
}

static gint by_name(gconstpointer a, gconstpointer b) {
    return g_utf8_collate(*(char *const *)a, *(char *const *)b);
}

/* Returns the names in the folder that have this ending, without it, sorted. The list is empty
 * without a folder. */
static GPtrArray *names_of(const struct web_task *task, const char *ending) {
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

static char *path_of(const char *folder, const char *name, const char *ending) {
    g_autofree char *file = g_strconcat(name, ending, NULL);
    return g_build_filename(folder, file, NULL);
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

void web_files_list(const struct web_task *task) {
    g_autoptr(GPtrArray) names = names_of(task, FILE_ENDING);
    GVariantBuilder entries;
    int n = 0;
    g_variant_builder_init(&entries, G_VARIANT_TYPE("aa{sv}"));
    for (guint i = 0; i < MIN(names->len, 2 * WEB_FILES_MAX) && n < WEB_FILES_MAX; i++) {
        struct stat info;
        g_autofree char *path = path_of(task->folder, names->pdata[i], FILE_ENDING);
        g_autofree char *text = read_file(path, &info);
        if (!text || !is_session(text))
            continue;
        add_entry(&entries, names->pdata[i], &info, TRUE);
        n++;
    }
    answer_list(task, "files", &entries);
}

void web_files_sessions(const struct web_task *task) {
    g_autoptr(GPtrArray) names = names_of(task, SESSION_ENDING);
    GVariantBuilder entries;
    g_variant_builder_init(&entries, G_VARIANT_TYPE("aa{sv}"));
    for (guint i = 0; i < MIN(names->len, WEB_FILES_MAX); i++) {
        struct stat info;
        g_autofree char *path = path_of(task->folder, names->pdata[i], SESSION_ENDING);
        if (lstat(path, &info) == 0 && S_ISDIR(info.st_mode))
            add_entry(&entries, names->pdata[i], &info, FALSE);
    }
    answer_list(task, "sessions", &entries);
}

/* Checks that there is a folder and that a name is allowed. Otherwise answers the task and returns
 * FALSE. */
static gboolean check_name(const struct web_task *task, const char *name) {
    if (!task->folder)
        web_task_refuse(task, SOUP_STATUS_NOT_FOUND,
                        "this server has no folder of sessions: start mesorig-web with "
                        "--sessions DIR");
    else if (!web_files_is_name(name))
        web_task_refuse(task, SOUP_STATUS_NOT_FOUND,
                        "a name of a session has 1 to 100 bytes, no slash, and does not begin "
                        "with a period");
    else
        return TRUE;
    return FALSE;
}

char *web_files_directory(const struct web_task *task) {
    struct stat info;
    if (!check_name(task, task->name))
        return NULL;
    g_autofree char *path = path_of(task->folder, task->name, SESSION_ENDING);
    if (lstat(path, &info) == 0 && S_ISDIR(info.st_mode))
        return g_steal_pointer(&path);
    g_autofree char *why = g_strdup_printf(
        "there is no session directory %s.session in the folder: /api/v1/sessions lists them",
        task->name);
    web_task_refuse(task, SOUP_STATUS_NOT_FOUND, why);
    return NULL;
}

/* What Validate, Start and QueueAdd need. */
struct request {
    char *path, *directory, *text;
};

static void request_clear(struct request *request) {
    g_free(request->path);
    g_free(request->directory);
    g_free(request->text);
}

/* Reads the session file of a task. Otherwise answers the task and returns FALSE. */
static gboolean read_request(const struct web_task *task, struct request *ret) {
    const char *session = web_task_value(task, "session");
    struct stat info;
    if (!check_name(task, task->name) || (session && !check_name(task, session)))
        return FALSE;
    ret->path = path_of(task->folder, task->name, FILE_ENDING);
    ret->directory = path_of(task->folder, session ? session : task->name, SESSION_ENDING);
    ret->text = read_file(ret->path, &info);
    if (ret->text)
        return TRUE;
    g_autofree char *why = g_strdup_printf(
        "the session file %s.conf cannot be read (%s): it must be a text file in UTF-8 of at most "
        "%d KiB and no link; /api/v1/files lists the session files",
        task->name, g_strerror(errno), WEB_FILES_MAX_BYTES >> 10);
    web_task_refuse(task, SOUP_STATUS_NOT_FOUND, why);
    return FALSE;
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
    struct request request = {0};
    GVariantDict options;
    if (read_request(task, &request)) {
        g_variant_dict_init(&options, NULL);
        g_variant_dict_insert(&options, "session_text", "s", request.text);
        web_task_call(task, "Validate",
                      g_variant_new("(ss@a{sv})", request.path, request.directory,
                                    g_variant_dict_end(&options)),
                      plan_json);
    }
    request_clear(&request);
}

void web_files_start(const struct web_task *task) {
    struct request request = {0};
    GVariantDict options;
    gboolean process;
    if (web_task_flag(task, "process", &process) && read_request(task, &request)) {
        g_variant_dict_init(&options, NULL);
        g_variant_dict_insert(&options, "session_text", "s", request.text);
        g_variant_dict_insert(&options, "process", "b", process);
        web_task_call(task, "Start",
                      g_variant_new("(ss@a{sv})", request.path, request.directory,
                                    g_variant_dict_end(&options)),
                      NULL);
    }
    request_clear(&request);
}

/* Converts the answer of QueueAdd, (ua{sv}). */
static char *number_json(GVariant *answer) {
    guint number;
    g_variant_get_child(answer, 0, "u", &number);
    return g_strdup_printf("{\"number\": %u}\n", number);
}

void web_files_queue(const struct web_task *task) {
    struct request request = {0};
    GVariantDict options;
    gboolean process, yes;
    if (web_task_flag(task, "process", &process) && web_task_flag(task, "yes", &yes) &&
        read_request(task, &request)) {
        g_variant_dict_init(&options, NULL);
        g_variant_dict_insert(&options, "session_text", "s", request.text);
        g_variant_dict_insert(&options, "process", "b", process);
        g_variant_dict_insert(&options, "yes", "b", yes);
        web_task_call(task, "QueueAdd",
                      g_variant_new("(ss@a{sv})", request.path, request.directory,
                                    g_variant_dict_end(&options)),
                      number_json);
    }
    request_clear(&request);
}

void web_files_resume(const struct web_task *task) {
    GVariantDict options;
    gboolean process;
    if (!web_task_flag(task, "process", &process))
        return;
    g_autofree char *directory = web_files_directory(task);
    if (!directory)
        return;
    g_variant_dict_init(&options, NULL);
    g_variant_dict_insert(&options, "process", "b", process);
    web_task_call(task, "Resume",
                  g_variant_new("(s@a{sv})", directory, g_variant_dict_end(&options)), NULL);
}
