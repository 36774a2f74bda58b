"""A living person at the stick: drives with an assistant, their recordings, and models of a person.

`stick` reads the person's stick, `drive` lets them drive a chair, `replay` asks another assistant
about a recorded drive, and `fit_driver` makes a simulated person like them.
"""
