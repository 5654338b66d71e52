"""The feature-point editor: named points over a photo, and the head that is fitted to them, seen at once.

:func:`~evalkit.editor.page.edit` shows it in a notebook, :func:`~evalkit.editor.server.serve` on a page of this machine
alone. It needs the extra ``editor`` (Panel and Bokeh).
"""
