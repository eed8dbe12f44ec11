/*
 * Output files. This module decides for all programs what happens to a file whose name a user has
 * given:
 *
 * - A name that does not exist is used.
 * - An existing file is refused, unless --force is given.
 * - A file that Mesorig itself has written as the same kind of product may be replaced, and the
 *   program says so (output_file_note()).
 * - A file that another program makes or changes while Mesorig works is kept, also with --force.
 * - A character device or a pipe is written to. A folder, a socket and a disk (block device) are
 *   refused. None of these is ever replaced.
 * - A symbolic link is followed and kept. A link to a file that does not exist is refused.
 *
 * A program calls output_file_new() before its long work, so that the user learns early that a name
 * is refused. It calls output_file_end() when the file is complete. Until then the file is in a
 * separate folder NAME.XXXXXXXX.part next to its final place. For a device or pipe, this folder is
 * in the folder for temporary files.
 *
 * If a complete file cannot be delivered, it is kept, and the error names it. It is then next to
 * its final place, or for a device or pipe in the folder for temporary files.
 *
 * A file is of a kind if it contains "mesorig.kind" and the kind: as an attribute of an EXR, as a
 * text chunk of a PNG, or as "mesorig.kind: KIND" in a comment of an HTML, SVG, PDF or PLY file or
 * of a text. Other formats cannot contain the kind. Their kind is NULL, and an existing file is
 * always refused without --force. Any thread may call the functions.
 */
#pragma once

#include <glib.h>

typedef struct OutputFile OutputFile;

/* Decides whether and how path is written. kind is a word for the product ("report"), or NULL.
 * Returns NULL on failure, with DATA_ERROR_EXISTS or DATA_ERROR_IO and an error that names path.
 * Nothing has been changed then. */
OutputFile *output_file_new(const char *path, const char *kind, gboolean force, GError **error);

/* The same as output_file_new(). It also locks the file until output_file_free(). Meanwhile this
 * function fails with G_IO_ERROR_BUSY (file_lock.h) in other programs. A device or pipe is not
 * locked. Removes the unfinished files that killed writers have left. */
OutputFile *output_file_new_locked(const char *path, const char *kind, gboolean force,
                                   GError **error);

/* Removes the written file if output_file_end() has neither delivered nor kept it. Releases the
 * lock. NULL is ignored. */
void output_file_free(OutputFile *file);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(OutputFile, output_file_free)

/* Makes only the decision of output_file_new(). Returns FALSE with an error if the name is
 * refused. */
gboolean output_file_check(const char *path, const char *kind, gboolean force, GError **error);

/* Returns the path to which the caller writes. No file has that name yet, and its last part is
 * the name of the output. The string belongs to file. Returns NULL if the folder for it cannot
 * be made. */
const char *output_file_path(OutputFile *file, GError **error);

/* Delivers the file that the caller has written to output_file_path(). written is FALSE if the
 * caller failed with *error. Nothing is then delivered, and the error is changed: it names the
 * output instead of output_file_path(). Adds the kind to PNG, SVG, PDF and HTML files; writers of
 * other formats add it themselves. Returns whether the output is complete. */
gboolean output_file_end(OutputFile *file, gboolean written, GError **error);

/* Writes and delivers n bytes: output_file_path(), output_file_write() and output_file_end() in one
 * call. */
gboolean output_file_put(OutputFile *file, const void *bytes, gsize n, GError **error);

/* Returns one line for the user about the file that existed before, without a newline. Returns NULL
 * if there was none. The string belongs to file. */
const char *output_file_note(const OutputFile *file);
/* If there is a note, prints it to stderr as "PROGRAM: PATH: NOTE". For programs other than the
 * commands of mesorig. */
void output_file_say(const OutputFile *file, const char *program);

gboolean output_file_streams(const OutputFile *file); /* whether the output is a device or pipe */

/* Gives the text that marks the kind in a comment of a text file. kind is a string constant. A
 * blank, a newline or a quotation mark must follow the text. */
#define OUTPUT_FILE_TEXT(kind) "mesorig.kind: " kind

/* Renames a file or folder and never replaces anything, not even an empty folder. Some file systems
 * (FUSE, NFS) cannot do that in one step. If such a file system also lacks hard links, a file of
 * that name that another program makes at the same moment may be lost. Returns FALSE and sets errno
 * on failure. errno is EEXIST if `to` exists. */
gboolean output_file_move(const char *from, const char *to);

/* Moves a finished folder to path, where nothing may exist. Returns FALSE if that fails. The folder
 * then stays next to path, and the error, DATA_ERROR_EXISTS or DATA_ERROR_IO, names it. */
gboolean output_file_move_folder(const char *folder, const char *path, GError **error);

/* Writes a file whose name Mesorig has chosen, or the file at output_file_path(). The file appears
 * under its name when all of it is on disk, and replaces an existing file. Errors are DATA_ERROR_IO
 * and name the file. */
gboolean output_file_write(const char *path, const void *bytes, gsize n, GError **error);
