// Written by Unreal's header tool in a real project.
