/* version.h - of the package: pyproject.toml has it too. */
#ifndef PMALPHA_VERSION_H
#define PMALPHA_VERSION_H

#define PMALPHA_VERSION "0.5.0"

#endif
