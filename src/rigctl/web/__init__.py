"""The project in a browser: `rigctl serve`, a local server over the same functions as the commands.

A part of the page is one module here and one script of the same name in ``assets``; `rigctl.web.parts` lists
them, `rigctl.web.request_handling` defines how a module answers, `rigctl.web.jobs` runs long computations,
and `rigctl.web.access_control` checks all requests.
"""
