#include "web_calibrations.h"

#include "base/json.h"
#include "base/output_file.h"
#include "web_files.h"

#include <errno.h>
#include <glib/gstdio.h>
#include <libsoup/soup.h>
#include <string.h>

#define DRAFT_ENDING  ".calibrating"
#define NEW_FOLDER    "new" /* folder in a draft to which a step writes */
#define FAILED        "failed.html"
#define EXAMPLE_BOARD "8x8,square=9,marker=6.75,thickness=3"
#define MAX_OPTION    200 /* bytes of the option --board */
#define MAX_FILE      (64 << 20)
#define MAX_TEXT      (64 << 10)
#define MAX_BYTES     (16 << 20) /* of a calibration, as in calibration.c */
#define MAX_DRAFTS    100

/* The steps in their order. */
static const struct step {
    const char *name;
    const char *file;    /* what a person looks at */
    gboolean calibrates; /* the step makes a calibration of sessions */
} steps[] = {
    {"board", "board.pdf", FALSE},           {"cameras", "cameras.html", TRUE},
    {"lights", "lights.html", TRUE},         {"laser", "laser.html", TRUE},
    {"radiometry", "radiometry.html", TRUE}, {"report", "report.html", FALSE},
};
#define N_STEPS ((int)G_N_ELEMENTS(steps))

/* A step that is being computed, or that has failed. */
struct work {
    WebCalibrations *calibrations;
    char *name, *draft; /* name of the calibration; path of its draft */
    const struct step *step;
    char *why; /* error message */
};

struct WebCalibrations {
    struct work *working, *failed; /* NULL if there is none */
};

static void work_free(struct work *work) {
    if (!work)
        return;
    g_free(work->name);
    g_free(work->draft);
    g_free(work->why);
    g_free(work);
}

WebCalibrations *web_calibrations_new(void) {
    return g_new0(WebCalibrations, 1);
}

void web_calibrations_free(WebCalibrations *calibrations) {
    if (!calibrations)
        return;
    work_free(calibrations->working);
    work_free(calibrations->failed);
    g_free(calibrations);
}

static char *file_of(const char *draft, const char *name, const char *ending) {
    g_autofree char *file = g_strconcat(name, ending, NULL);
    return g_build_filename(draft, file, NULL);
}

static gboolean is_directory(const char *path) {
    struct stat info;
    return lstat(path, &info) == 0 && S_ISDIR(info.st_mode);
}

static gboolean is_file(const char *path) {
    struct stat info;
    return lstat(path, &info) == 0 && S_ISREG(info.st_mode);
}

/* Returns the calibration of the last step before this one; g_free(). Returns NULL if there is
 * none. */
static char *last_before(const char *draft, const struct step *step) {
    while (step-- > steps) {
        g_autofree char *path = file_of(draft, step->name, WEB_FILES_CALIBRATION);
        if (step->calibrates && is_file(path))
            return g_steal_pointer(&path);
    }
    return NULL;
}

/* Removes the files of a step from a folder. */
static void remove_step(const char *folder, const struct step *step) {
    static const char *const endings[] = {WEB_FILES_CALIBRATION, ".txt"};
    g_autofree char *file = g_build_filename(folder, step->file, NULL);
    g_unlink(file);
    for (gsize i = 0; i < G_N_ELEMENTS(endings); i++) {
        g_autofree char *path = file_of(folder, step->name, endings[i]);
        g_unlink(path);
    }
}

/* Makes an empty folder in the draft. Returns its path; g_free(). Returns NULL with errno. */
static char *make_new(const char *draft) {
    g_autofree char *path = g_build_filename(draft, NEW_FOLDER, NULL);
    if ((g_mkdir(draft, 0777) != 0 && errno != EEXIST) || !is_directory(draft) ||
        (g_mkdir(path, 0777) != 0 && errno != EEXIST) || !is_directory(path))
        return NULL;
    for (int i = 0; i < N_STEPS; i++)
        remove_step(path, &steps[i]);
    return g_steal_pointer(&path);
}

static gboolean move(const char *from, const char *name, const char *to, const char *new_name) {
    g_autofree char *old_path = g_build_filename(from, name, NULL);
    g_autofree char *new_path = g_build_filename(to, new_name, NULL);
    return g_rename(old_path, new_path) == 0;
}

/* Returns what mesorig has printed without the path of its output and without advice to run another
 * command; g_free(). */
static char *for_page(const char *text) {
    g_autoptr(GRegex) ours = g_regex_new(
        "\\A[^\\n]*?/new/[a-z]+\\.calibration: |(\\A|\\n|; )mesorig calibrate [^\\n]*", 0, 0, NULL);
    return g_regex_replace_literal(ours, text, -1, 0, "", 0, NULL);
}

/* Moves the result of a step into the draft, the calibration after its other files. Then removes
 * the results of later steps. Returns FALSE with errno if that fails. */
static gboolean deliver(const struct work *work, const char *folder, const char *text) {
    const struct step *step = work->step;
    g_autofree char *calibration = g_strconcat(step->name, WEB_FILES_CALIBRATION, NULL);
    g_autofree char *said = file_of(work->draft, step->name, ".txt");
    g_autofree char *shown = for_page(text);
    if (!move(folder, step->file, work->draft, step->file))
        return FALSE;
    if (!step->calibrates)
        return TRUE;
    if (!g_file_set_contents(said, shown ? shown : text, -1, NULL) ||
        !move(folder, calibration, work->draft, calibration))
        return FALSE;
    for (const struct step *later = step + 1; later < steps + N_STEPS; later++)
        remove_step(work->draft, later);
    return TRUE;
}

static void on_found(gboolean ok, const char *text, gpointer data) {
    struct work *work = data;
    WebCalibrations *calibrations = work->calibrations;
    g_autofree char *folder = g_build_filename(work->draft, NEW_FOLDER, NULL);
    calibrations->working = NULL;
    if (ok && deliver(work, folder, text)) {
        remove_step(folder, work->step);
        g_rmdir(folder);
        work_free(work);
        return;
    }
    work->why = ok ? g_strdup_printf("the result cannot be stored in %s: %s", work->draft,
                                     g_strerror(errno))
                   : g_strdup(text);
    move(folder, work->step->file, work->draft, FAILED); /* only a step with pictures */
    remove_step(folder, work->step);
    g_rmdir(folder);
    calibrations->failed = work;
}

/* Returns an option that a step needs. If the query lacks it, answers the task with 409, because
 * other steps do not need it, and returns NULL. */
static const char *needed(const struct web_task *task, const struct step *step, const char *key,
                          const char *example) {
    const char *value = web_task_value(task, key);
    if (value)
        return value;
    g_autofree char *why = g_strdup_printf("the step %s needs %s in the query, such as %s=%s",
                                           step->name, key, key, example);
    web_task_refuse(task, SOUP_STATUS_CONFLICT, why);
    return NULL;
}

/* Adds the directories of the sessions that the query names. If the query or a name is wrong, or a
 * session does not exist, answers the task and returns FALSE. */
static gboolean add_sessions(const struct web_task *task, const struct step *step,
                             GPtrArray *arguments) {
    const char *value = needed(task, step, "sessions", "flat/leaning");
    if (!value)
        return FALSE;
    g_auto(GStrv) names = g_strsplit(value, "/", WEB_CALIBRATIONS_SESSIONS + 1);
    const guint n = g_strv_length(names);
    if (n == 0 || n > WEB_CALIBRATIONS_SESSIONS) {
        web_task_refuse(task, SOUP_STATUS_BAD_REQUEST,
                        "the query needs the names of 1 to 16 sessions with '/' between them, such "
                        "as sessions=flat/leaning");
        return FALSE;
    }
    for (guint i = 0; i < n; i++) {
        char *directory = web_files_directory(task, names[i]);
        if (!directory)
            return FALSE;
        g_ptr_array_add(arguments, directory);
    }
    return TRUE;
}

/* Adds the option that a step needs, if it needs one. If the query lacks it or its value is wrong,
 * answers the task and returns FALSE. */
static gboolean add_option(const struct web_task *task, const struct step *step,
                           GPtrArray *arguments) {
    const gboolean has_board =
        strcmp(step->name, "board") == 0 || strcmp(step->name, "cameras") == 0;
    if (has_board) {
        const char *board = needed(task, step, "board", EXAMPLE_BOARD);
        if (!board)
            return FALSE;
        if (!*board || strlen(board) > MAX_OPTION || !g_utf8_validate(board, -1, NULL)) {
            web_task_refuse(task, SOUP_STATUS_BAD_REQUEST,
                            "the board has 1 to 200 bytes in UTF-8, such as "
                            "board=" EXAMPLE_BOARD);
            return FALSE;
        }
        g_ptr_array_add(arguments, g_strconcat("--board=", board, NULL));
    } else if (strcmp(step->name, "lights") == 0) {
        const char *target = needed(task, step, "target", "poles");
        struct stat info;
        if (!target || !web_files_check(task, target))
            return FALSE;
        g_autofree char *path = web_files_path(task, target, ".conf");
        g_autofree char *text = web_files_read(path, WEB_FILES_MAX_BYTES, &info);
        if (!text) {
            web_task_refuse(task, SOUP_STATUS_NOT_FOUND,
                            "there is no such target in the folder: /api/v1/calibrations lists "
                            "them");
            return FALSE;
        }
        g_ptr_array_add(arguments, g_strconcat("--target=", path, NULL));
    } else if (strcmp(step->name, "radiometry") == 0) {
        double reflectance;
        char text[G_ASCII_DTOSTR_BUF_SIZE];
        if (!needed(task, step, "reflectance", "0.96") ||
            !web_task_number(task, "reflectance", 0.05, 1.2, &reflectance))
            return FALSE;
        g_ascii_dtostr(text, sizeof text, reflectance);
        g_ptr_array_add(arguments, g_strconcat("--reflectance=", text, NULL));
    }
    return TRUE;
}

/* Returns the arguments of mesorig for a step; g_ptr_array_unref(). If the query is wrong, or an
 * earlier step must come first, answers the task and returns NULL. */
static GPtrArray *arguments_of(const struct web_task *task, const struct step *step,
                               const char *draft) {
    g_autoptr(GPtrArray) to = g_ptr_array_new_with_free_func(g_free);
    g_autofree char *last = last_before(draft, step);
    g_autofree char *folder = g_build_filename(draft, NEW_FOLDER, NULL);
    g_autofree char *file = g_build_filename(folder, step->file, NULL);
    const gboolean is_board = strcmp(step->name, "board") == 0;
    if (!is_board)
        g_ptr_array_add(to, g_strdup("calibrate"));
    g_ptr_array_add(to, g_strdup(step->name));
    if (!step->calibrates && !is_board && !last) {
        web_task_refuse(task, SOUP_STATUS_CONFLICT,
                        "nothing is calibrated yet: calibrate the cameras first");
        return NULL;
    }
    if ((step->calibrates && !add_sessions(task, step, to)) || !add_option(task, step, to))
        return NULL;
    if (step->calibrates) {
        g_ptr_array_add(to, g_strconcat("--found=", file, NULL));
        g_ptr_array_add(to, g_strdup("-o"));
        g_ptr_array_add(to, file_of(folder, step->name, WEB_FILES_CALIBRATION));
        if (last) {
            g_ptr_array_add(to, g_strdup("-c"));
            g_ptr_array_add(to, g_steal_pointer(&last));
        }
    } else if (is_board) {
        g_ptr_array_add(to, g_steal_pointer(&file));
    } else {
        g_ptr_array_add(to, g_steal_pointer(&last));
        g_ptr_array_add(to, g_strdup("-o"));
        g_ptr_array_add(to, g_steal_pointer(&file));
    }
    g_ptr_array_add(to, NULL);
    return g_steal_pointer(&to);
}

/* Returns whether the calibration of a task can still be changed. If not, answers the task. */
static gboolean check_open(const struct web_task *task) {
    struct stat info;
    if (!web_files_check(task, task->name))
        return FALSE;
    g_autofree char *path = web_files_path(task, task->name, WEB_FILES_CALIBRATION);
    if (lstat(path, &info) != 0)
        return TRUE;
    g_autofree char *why = g_strdup_printf(
        "the calibration %s exists and is never replaced: choose another name", task->name);
    web_task_refuse(task, SOUP_STATUS_CONFLICT, why);
    return FALSE;
}

void web_calibrations_find(const struct web_task *task) {
    WebCalibrations *calibrations = task->calibrations;
    const char *wanted = web_task_value(task, "step");
    const struct step *step = NULL;
    g_autoptr(GError) error = NULL;
    for (int i = 0; i < N_STEPS; i++)
        if (g_strcmp0(steps[i].name, wanted) == 0)
            step = &steps[i];
    if (!step) {
        web_task_refuse(task, SOUP_STATUS_BAD_REQUEST,
                        "the query needs the step: step=board, cameras, lights, laser, radiometry "
                        "or report");
        return;
    }
    double reflectance; /* an option of another step must be right as well */
    if ((web_task_value(task, "reflectance") &&
         !web_task_number(task, "reflectance", 0.05, 1.2, &reflectance)) ||
        !check_open(task))
        return;
    g_autofree char *draft = web_files_path(task, task->name, DRAFT_ENDING);
    g_autoptr(GPtrArray) arguments = arguments_of(task, step, draft);
    if (!arguments)
        return;
    /* While a step is computed, its files are in this folder. */
    g_autofree char *folder = calibrations->working ? NULL : make_new(draft);
    if (!folder && !calibrations->working) {
        g_autofree char *why = g_strdup_printf(
            "the folder %s" DRAFT_ENDING " cannot be made (%s): let the user of mesorig-web write "
            "in the folder of --sessions",
            task->name, g_strerror(errno));
        web_task_refuse(task, SOUP_STATUS_CONFLICT, why);
        return;
    }
    struct work *work = g_new0(struct work, 1);
    *work = (struct work){calibrations, g_strdup(task->name), g_steal_pointer(&draft), step, NULL};
    if (!web_child_start(task->child, (const char *const *)arguments->pdata, on_found, work,
                         &error)) {
        if (folder) {
            g_rmdir(folder);
            g_rmdir(work->draft); /* if nothing else is in it */
        }
        work_free(work);
        web_task_refuse(task, SOUP_STATUS_CONFLICT, error->message);
        return;
    }
    g_autofree char *failed = g_build_filename(work->draft, FAILED, NULL);
    g_unlink(failed);
    g_clear_pointer(&calibrations->failed, work_free);
    calibrations->working = work;
    web_task_answer(task, SOUP_STATUS_OK, "{}\n");
}

void web_calibrations_keep(const struct web_task *task) {
    const WebCalibrations *calibrations = task->calibrations;
    struct stat info;
    if (!check_open(task))
        return;
    g_autofree char *draft = web_files_path(task, task->name, DRAFT_ENDING);
    g_autofree char *last = last_before(draft, &steps[N_STEPS - 1]);
    g_autofree char *text = last ? web_files_read(last, MAX_BYTES, &info) : NULL;
    if (calibrations->working && strcmp(calibrations->working->name, task->name) == 0) {
        web_task_refuse(task, SOUP_STATUS_CONFLICT,
                        "a step of this calibration is being computed: wait until it is ready");
        return;
    }
    if (!text) {
        web_task_refuse(task, SOUP_STATUS_CONFLICT,
                        "nothing of this calibration was computed: calibrate the cameras first");
        return;
    }
    g_autofree char *copy = g_build_filename(draft, "kept", NULL);
    g_autofree char *path = web_files_path(task, task->name, WEB_FILES_CALIBRATION);
    /* mesorigd may have another user, and reads the file if the rig file names it. */
    if (g_file_set_contents(copy, text, -1, NULL) && g_chmod(copy, 0644) == 0 &&
        output_file_move(copy, path)) {
        web_task_answer(task, SOUP_STATUS_OK, "{}\n");
        return;
    }
    g_autofree char *why = g_strdup_printf("%s" WEB_FILES_CALIBRATION " cannot be written: %s",
                                           task->name, g_strerror(errno));
    web_task_refuse(task, SOUP_STATUS_CONFLICT, why);
}

static void add_text(GVariantBuilder *to, const char *key, const char *value) {
    g_variant_builder_add(to, "{sv}", key, g_variant_new_string(value));
}

/* Adds an entry for a draft: {"name", "steps", "files"}. */
static void add_draft(const struct web_task *task, const char *name, GVariantBuilder *to) {
    g_autofree char *draft = web_files_path(task, name, DRAFT_ENDING);
    GVariantBuilder done, files;
    struct stat info;
    if (!is_directory(draft))
        return;
    g_variant_builder_init(&done, G_VARIANT_TYPE("aa{sv}"));
    g_variant_builder_init(&files, G_VARIANT_TYPE("as"));
    for (int i = 0; i < N_STEPS; i++) {
        g_autofree char *calibration = file_of(draft, steps[i].name, WEB_FILES_CALIBRATION);
        g_autofree char *said = file_of(draft, steps[i].name, ".txt");
        g_autofree char *file = g_build_filename(draft, steps[i].file, NULL);
        if (is_file(file))
            g_variant_builder_add(&files, "s", steps[i].file);
        if (!steps[i].calibrates || !is_file(calibration))
            continue;
        g_autofree char *text = web_files_read(said, MAX_TEXT, &info);
        g_variant_builder_open(&done, G_VARIANT_TYPE_VARDICT);
        add_text(&done, "step", steps[i].name);
        add_text(&done, "text", text ? text : "");
        g_variant_builder_close(&done);
    }
    g_autofree char *failed = g_build_filename(draft, FAILED, NULL);
    if (is_file(failed))
        g_variant_builder_add(&files, "s", FAILED);
    g_variant_builder_open(to, G_VARIANT_TYPE_VARDICT);
    add_text(to, "name", name);
    g_variant_builder_add(to, "{sv}", "steps", g_variant_builder_end(&done));
    g_variant_builder_add(to, "{sv}", "files", g_variant_builder_end(&files));
    g_variant_builder_close(to);
}

/* Returns a GVariant of type maybe: an object that describes the step, or nothing if work is
 * NULL. */
static GVariant *describe(const struct work *work) {
    GVariantBuilder to;
    if (!work)
        return g_variant_new_maybe(G_VARIANT_TYPE_VARDICT, NULL);
    g_variant_builder_init(&to, G_VARIANT_TYPE_VARDICT);
    add_text(&to, "name", work->name);
    add_text(&to, "step", work->step->name);
    if (work->why)
        add_text(&to, "why", work->why);
    return g_variant_new_maybe(NULL, g_variant_builder_end(&to));
}

void web_calibrations_list(const struct web_task *task) {
    const WebCalibrations *calibrations = task->calibrations;
    g_autoptr(GPtrArray) names = web_files_names(task, WEB_FILES_CALIBRATION);
    g_autoptr(GPtrArray) drafted = web_files_names(task, DRAFT_ENDING);
    GVariantBuilder to, targets, kept, drafts;
    g_variant_builder_init(&targets, G_VARIANT_TYPE("aa{sv}"));
    g_variant_builder_init(&kept, G_VARIANT_TYPE("aa{sv}"));
    g_variant_builder_init(&drafts, G_VARIANT_TYPE("aa{sv}"));
    web_files_add_section(task, "[target]", &targets);
    web_files_add(task, names, WEB_FILES_CALIBRATION, S_IFREG, &kept);
    for (guint i = 0; i < MIN(drafted->len, MAX_DRAFTS); i++)
        add_draft(task, drafted->pdata[i], &drafts);
    g_variant_builder_init(&to, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&to, "{sv}", "folder", g_variant_new_boolean(task->folder != NULL));
    g_variant_builder_add(&to, "{sv}", "targets", g_variant_builder_end(&targets));
    g_variant_builder_add(&to, "{sv}", "calibrations", g_variant_builder_end(&kept));
    g_variant_builder_add(&to, "{sv}", "drafts", g_variant_builder_end(&drafts));
    g_variant_builder_add(&to, "{sv}", "working", describe(calibrations->working));
    g_variant_builder_add(&to, "{sv}", "failed", describe(calibrations->failed));
    g_autofree char *json = json_text(g_variant_builder_end(&to));
    web_task_answer(task, SOUP_STATUS_OK, json);
}

/* Answers with a file of the draft. */
static void send_file(const struct web_task *task, const char *name, const char *type) {
    if (!web_files_check(task, task->name))
        return;
    g_autofree char *draft = web_files_path(task, task->name, DRAFT_ENDING);
    g_autofree char *path = g_build_filename(draft, name, NULL);
    g_autoptr(GMappedFile) file =
        is_directory(draft) && is_file(path) ? g_mapped_file_new(path, FALSE, NULL) : NULL;
    if (!file || g_mapped_file_get_length(file) > MAX_FILE) {
        web_task_refuse(task, SOUP_STATUS_NOT_FOUND,
                        "this step was not computed: /api/v1/calibrations lists what was");
        return;
    }
    g_autoptr(GBytes) bytes = g_mapped_file_get_bytes(file);
    web_task_bytes(task, type, bytes);
}

void web_calibrations_page(const struct web_task *task) {
    const char *wanted = web_task_value(task, "step");
    const char *file = g_strcmp0(wanted, "failed") == 0 ? FAILED : NULL;
    for (int i = 0; i < N_STEPS; i++)
        if (g_strcmp0(steps[i].name, wanted) == 0 && g_str_has_suffix(steps[i].file, ".html"))
            file = steps[i].file;
    if (file)
        send_file(task, file, "text/html; charset=utf-8");
    else
        web_task_refuse(task, SOUP_STATUS_BAD_REQUEST,
                        "the query needs the page: step=cameras, lights, laser, radiometry, report "
                        "or failed");
}

void web_calibrations_board(const struct web_task *task) {
    send_file(task, "board.pdf", "application/pdf");
}
